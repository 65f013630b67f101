!> The geometry of a planar beam element: its deformations (e, phi1, phi2) from the coordinates of its ends, in element axes
!> u1 v1 r1 u2 v2 r2 (theory.md, section 4; VRL 17-19). Its stiffness and inertia are those of its section (`layered_element`).
module beam_element
  use kinds, only: wp
  use small_matrices, only: outer
  implicit none (type, external)
  private
  public :: beam_geometry, deformation_matrix, element_rotation, geometric_stiffness, present_deformation_matrix

  !> A straight element between two nodes of a body, with what every formula about it needs.
  type :: beam_geometry
    real(wp) :: length = 0.0_wp   !! [m]
    real(wp) :: c = 1.0_wp        !! cosine of the element angle in body axes [-]
    real(wp) :: s = 0.0_wp        !! sine of the element angle in body axes [-]
    real(wp) :: mass = 0.0_wp     !! rho A L [kg]
    real(wp) :: ea_l = 0.0_wp     !! E_R A / L [N/m]
    real(wp) :: ei_l = 0.0_wp     !! E_R I / L [N m]
    real(wp) :: turn_l = 0.0_wp   !! of one layer: stiffness by (phi1 + phi2)/2, 12 ei_l without shear; of several 0 [N m]
    real(wp) :: area = 0.0_wp     !! A [m2]
    real(wp) :: second = 0.0_wp   !! I [m4]
    real(wp) :: fibre = 0.0_wp    !! distance of the outer fibre, 0: none [m]
    real(wp) :: softening = 0.0_wp  !! by shear: v' = r - this (phi1 + phi2)/2 at the ends (`layered_element`) [-]
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
end module beam_element
