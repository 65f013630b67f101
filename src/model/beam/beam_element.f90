!> The planar Euler-Bernoulli beam element: linear axial and cubic transverse interpolation. Coordinates of an
!> element, in element axes: u1 v1 r1 u2 v2 r2. Closed forms of theory.md, section 2 (VRL 17-19).
module beam_element
  use kinds, only: wp
  use small_matrices, only: outer
  implicit none (type, external)
  private
  public :: beam_geometry, element_rotation, shape_integral, shape_moment, element_mass, element_gyroscopic
  public :: deformation_stiffness, deformation_matrix, present_deformation_matrix, deformation_law, geometric_stiffness

  !> End moments by end rotations from the chord, over E I/l [-].
  real(wp), parameter, public :: bending(2, 2) = reshape([4.0_wp, 2.0_wp, 2.0_wp, 4.0_wp], [2, 2])

  !> A straight element between two nodes of a body, with what every formula about it needs.
  type :: beam_geometry
    real(wp) :: length = 0.0_wp   !! [m]
    real(wp) :: c = 1.0_wp        !! cosine of the element angle in body axes [-]
    real(wp) :: s = 0.0_wp        !! sine of the element angle in body axes [-]
    real(wp) :: mass = 0.0_wp     !! rho A L [kg]
    real(wp) :: ea_l = 0.0_wp     !! E_R A / L [N/m]
    real(wp) :: ei_l = 0.0_wp     !! E_R I / L [N m]
    real(wp) :: ray_m = 0.0_wp    !! Rayleigh mass coefficient [1/s]
    real(wp) :: ray_k = 0.0_wp    !! Rayleigh stiffness coefficient [s]
    real(wp) :: area = 0.0_wp     !! A [m2]
    real(wp) :: second = 0.0_wp   !! I [m4]
    real(wp) :: fibre = 0.0_wp    !! distance of the outer fibre, 0: none [m]
    real(wp) :: softening = 0.0_wp  !! by shear: v' = r - this (phi1 + phi2)/2 at the ends (`layered_element`) [-]
    integer :: material = 0       !! index of the material
  end type beam_geometry

contains

  !> T (6 x 6): element-axes coordinates from body-axes ones, q_element = T q_body (VRL 4-7).
  pure function element_rotation(g) result(t)
    type(beam_geometry), intent(in) :: g
    real(wp) :: t(6, 6)   !! [-]
    integer :: k
    t = 0.0_wp
    do k = 0, 3, 3
      t(k + 1, k + 1:k + 2) = [g%c, g%s]
      t(k + 2, k + 1:k + 2) = [-g%s, g%c]
      t(k + 3, k + 3) = 1.0_wp
    end do
  end function element_rotation

  !> Integral of N rho A dx (2 x 6), body axes [kg].
  pure function shape_integral(g) result(s)
    type(beam_geometry), intent(in) :: g
    real(wp) :: s(2, 6)
    s = 0.0_wp
    s(1, [1, 4]) = 0.5_wp
    s(2, [2, 3, 5, 6]) = [0.5_wp, g%length/12.0_wp, 0.5_wp, -g%length/12.0_wp]
    s = g%mass*to_body(g, s)
  end function shape_integral

  !> Integral of xi N rho A dx (2 x 6), xi from 0 to 1 along the element, body axes [kg].
  pure function shape_moment(g) result(s)
    type(beam_geometry), intent(in) :: g
    real(wp) :: s(2, 6)
    s = 0.0_wp
    s(1, [1, 4]) = [1.0_wp/6.0_wp, 1.0_wp/3.0_wp]
    s(2, [2, 3, 5, 6]) = [3.0_wp/20.0_wp, g%length/30.0_wp, 7.0_wp/20.0_wp, -g%length/20.0_wp]
    s = g%mass*to_body(g, s)
  end function shape_moment

  !> Turns a 2 x 6 matrix from element axes into body axes on both sides.
  pure function to_body(g, s) result(b)
    type(beam_geometry), intent(in) :: g
    real(wp), intent(in) :: s(2, 6)   !! per unit mass, element axes [-], [m]
    real(wp) :: b(2, 6), r(2, 2), t(6, 6)
    t = element_rotation(g)
    r = reshape([g%c, g%s, -g%s, g%c], [2, 2])
    b = matmul(r, matmul(s, t))
  end function to_body

  !> Consistent mass matrix (6 x 6), body axes [kg, kg m, kg m2].
  pure function element_mass(g) result(m)
    type(beam_geometry), intent(in) :: g
    real(wp) :: m(6, 6), l
    l = g%length
    m = 0.0_wp
    m(1, [1, 4]) = [140.0_wp, 70.0_wp]
    m(4, [1, 4]) = [70.0_wp, 140.0_wp]
    m(2, [2, 3, 5, 6]) = [156.0_wp, 22.0_wp*l, 54.0_wp, -13.0_wp*l]
    m(3, [2, 3, 5, 6]) = [22.0_wp*l, 4.0_wp*l**2, 13.0_wp*l, -3.0_wp*l**2]
    m(5, [2, 3, 5, 6]) = [54.0_wp, 13.0_wp*l, 156.0_wp, -22.0_wp*l]
    m(6, [2, 3, 5, 6]) = [-13.0_wp*l, -3.0_wp*l**2, -22.0_wp*l, 4.0_wp*l**2]
    m = g%mass/420.0_wp*congruent(g, m)
  end function element_mass

  !> Z = integral of N^T H^T N rho A dx (6 x 6, skew), body axes [kg, kg m]; it does not depend on the element's angle
  !> except through the coordinates.
  pure function element_gyroscopic(g) result(z)
    type(beam_geometry), intent(in) :: g
    real(wp) :: z(6, 6), l
    l = g%length
    z = 0.0_wp
    z(1, [2, 3, 5, 6]) = [7.0_wp/20.0_wp, l/20.0_wp, 3.0_wp/20.0_wp, -l/30.0_wp]
    z(4, [2, 3, 5, 6]) = [3.0_wp/20.0_wp, l/30.0_wp, 7.0_wp/20.0_wp, -l/20.0_wp]
    z = z - transpose(z)
    z = g%mass*congruent(g, z)
  end function element_gyroscopic

  !> B (3 x 6): deformations (e, phi1, phi2) from body-axes coordinates (theory.md, section 4).
  pure function deformation_matrix(g) result(b)
    type(beam_geometry), intent(in) :: g
    real(wp) :: b(3, 6), local(3, 6), t(6, 6), il
    t = element_rotation(g)
    il = 1.0_wp/g%length
    local = 0.0_wp
    local(1, [1, 4]) = [-1.0_wp, 1.0_wp]
    local(2, [2, 3, 5]) = [il, 1.0_wp, -il]
    local(3, [2, 5, 6]) = [il, -il, 1.0_wp]
    b = matmul(local, t)
  end function deformation_matrix

  !> The chord's turn is psi x, x coordinates in body axes.
  pure function chord_turn(g) result(psi)
    type(beam_geometry), intent(in) :: g
    real(wp) :: psi(6)   !! [1/m]
    psi = [g%s, -g%c, 0.0_wp, -g%s, g%c, 0.0_wp]/g%length
  end function chord_turn

  !> Turns of the axis at both ends against the chord (2 x 6): those of the sections less the shear.
  pure function end_slopes(g, b) result(slopes)
    type(beam_geometry), intent(in) :: g
    real(wp), intent(in) :: b(3, 6)            !! deformations from coordinates [-], [1/m]
    real(wp) :: slopes(2, 6)                   !! [-], [1/m]
    slopes = b(2:3, :) - spread(0.5_wp*g%softening*(b(2, :) + b(3, :)), 1, 2)
  end function end_slopes

  !> B (3 x 6) of an element with geometric stiffening at its present coordinates (theory.md, section 4).
  pure function present_deformation_matrix(g, x) result(b)
    type(beam_geometry), intent(in) :: g
    real(wp), intent(in) :: x(6)               !! body axes [m, rad]
    real(wp) :: b(3, 6), slopes(2, 6), psi(6), p(3)
    b = deformation_matrix(g)
    slopes = end_slopes(g, b)
    psi = chord_turn(g)
    p = [dot_product(psi, x), matmul(slopes, x)]
    b(1, :) = b(1, :) + g%length*(p(1)*psi + ((4*p(2) - p(3))*slopes(1, :) + (4*p(3) - p(2))*slopes(2, :))/30)
  end function present_deformation_matrix

  !> D (3 x 3) at E_R: forces and moments from deformations (theory.md, section 4) [N/m], [N m].
  pure function deformation_law(g) result(d)
    type(beam_geometry), intent(in) :: g
    real(wp) :: d(3, 3)
    d = 0.0_wp
    d(1, 1) = g%ea_l
    d(2:3, 2:3) = bending*g%ei_l
  end function deformation_law

  !> B^T D B with D at E_R.
  pure function deformation_stiffness(g, b) result(k)
    type(beam_geometry), intent(in) :: g
    real(wp), intent(in) :: b(3, 6)    !! deformations from coordinates [-], [1/m]
    real(wp) :: k(6, 6), db(3, 6)
    db = matmul(deformation_law(g), b)
    k = matmul(transpose(b), db)
  end function deformation_stiffness

  !> Geometric stiffness of the whole axial stress n, damping terms' part included: n times the second derivative of e.
  pure function geometric_stiffness(g, n) result(k)
    type(beam_geometry), intent(in) :: g
    real(wp), intent(in) :: n                  !! conjugate to the axial deformation [N]
    real(wp) :: k(6, 6)                        !! [N/m, N, N m]
    real(wp) :: b(2, 6), psi(6)
    b = end_slopes(g, deformation_matrix(g))
    psi = chord_turn(g)
    k = n*g%length*(outer(psi, psi) + (4*outer(b(1, :), b(1, :)) + 4*outer(b(2, :), b(2, :)) &
                                       - outer(b(1, :), b(2, :)) - outer(b(2, :), b(1, :)))/30)
  end function geometric_stiffness

  !> T^T m T: a 6 x 6 matrix from element into body axes.
  pure function congruent(g, m) result(b)
    type(beam_geometry), intent(in) :: g
    real(wp), intent(in) :: m(6, 6)   !! element axes [unit of the matrix]
    real(wp) :: b(6, 6), t(6, 6), mt(6, 6)
    t = element_rotation(g)
    mt = matmul(m, t)
    b = matmul(transpose(t), mt)
  end function congruent
end module beam_element
