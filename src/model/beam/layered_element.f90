!> Elements of beams and frames, of one layer or several (theory.md, sections 4 and 16). Coordinates in element axes:
!> u1 v1 r1 u2 v2 r2, then of each core g1 g2 p: its shear angle at both nodes and the element's own part, which is quadratic.
!> Deformations in the same order: e phi1 phi2, then g1 g2 p. Strains are at most linear along the element: their mean and
!> their change make rows whose energies add up, V = 1/2 sum of stiffness times row squared.
module layered_element
  use kinds, only: wp
  use layered_section, only: layered_section_model, most_cores, section_layer
  implicit none (type, external)
  private
  public :: make_layered_element

  integer, parameter, public :: most_coordinates = 6 + 3*most_cores     !! of an element

  !> Inertia of an element.
  type, public :: element_inertia
    real(wp), allocatable :: m(:, :), j(:, :), z(:, :)   !! translational and rotary inertia, Z [kg, kg m, kg m2]
    real(wp), allocatable :: c(:, :)           !! Rayleigh damping by the mass [kg/s, ...]
    real(wp), allocatable :: s(:, :)           !! (2, coordinates) integral of N [kg, kg m]
    real(wp), allocatable :: along(:)          !! integral of u0.N, u0 from the first node [kg m, kg m2]
    real(wp), allocatable :: turning(:)        !! integral of (H u0).N and of the layers' turns [kg m, kg m2]
  end type element_inertia

  !> Rows and inertia, element axes, of elements with one section and one length.
  type, extends(element_inertia), public :: layered_element_model
    real(wp) :: length = 0.0_wp                !! [m]
    integer :: section = 0                     !! number among the body's sections
    integer :: coordinates = 6
    integer :: deformations = 3
    real(wp) :: softening = 0.0_wp             !! Phi/(1 + Phi): v' = r - this (phi1 + phi2)/2 [-]
    real(wp), allocatable :: rows(:, :)        !! (rows, deformations) [-], [m], [1/m]
    real(wp), allocatable :: stiffness(:)      !! (rows) at E_R [N/m], [N m]
    real(wp), allocatable :: force(:, :)       !! (deformations, rows): rows^T stiffness [N/m], [N], [N m]
    integer, allocatable :: layer(:)           !! (rows)
    integer, allocatable :: material(:)        !! (rows) whose terms follow the row, 0: none
    logical, allocatable :: angle(:)           !! (rows) the row is an angle
    logical, allocatable :: shear(:)           !! (rows) shear angle of a core
    real(wp), allocatable :: strain(:, :)      !! (4, rows) of the layer's lower and upper face at both ends by the row [1/m]
    real(wp), allocatable :: ray_k(:)          !! (rows) [s]
    real(wp) :: mass = 0.0_wp                  !! [kg]
    real(wp) :: first = 0.0_wp                 !! of the mass, above the node line [kg m]
    real(wp) :: second = 0.0_wp                !! about the node line [kg m2]
  end type layered_element_model

contains

  !> An element of a section; without axial deformation e is no deformation.
  function make_layered_element(s, number, length, axial) result(x)
    type(layered_section_model), intent(in) :: s
    integer, intent(in) :: number              !! of the section
    real(wp), intent(in) :: length             !! [m]
    logical, intent(in) :: axial
    type(layered_element_model) :: x
    real(wp) :: phi
    x%length = length
    x%section = number
    x%coordinates = 6 + 3*s%cores
    x%deformations = 3 + 3*s%cores
    if (s%shears) then
      phi = 12*s%bending/(sum(s%layers%shear*s%layers%area)*length**2)
      x%softening = phi/(1 + phi)
    end if
    call add_rows(s, axial, x)
    call add_inertia(s, x)
  end function make_layered_element

  !> Rows and their stiffness.
  subroutine add_rows(s, axial, x)
    type(layered_section_model), intent(in) :: s
    logical, intent(in) :: axial
    type(layered_element_model), intent(inout) :: x
    real(wp), dimension(x%deformations) :: stretch, difference, turn, bubble   ! e, phi2 - phi1, (phi1 + phi2)/2, q [-]
    real(wp) :: rows(6*size(s%layers), x%deformations)
    real(wp), parameter :: one(4) = 1.0_wp, ends(4) = [1.0_wp, 1.0_wp, -1.0_wp, -1.0_wp]   ! of a mean, of a change [-]
    integer :: l, n
    n = 0
    allocate (x%stiffness(size(rows, 1)), x%ray_k(size(rows, 1)), x%layer(size(rows, 1)), x%material(size(rows, 1)), &
              x%angle(size(rows, 1)), x%shear(size(rows, 1)), x%strain(4, size(rows, 1)))
    stretch = 0.0_wp
    if (axial) stretch(1) = 1.0_wp
    difference = 0.0_wp
    difference(2:3) = [-1.0_wp, 1.0_wp]
    turn = 0.0_wp
    turn(2:3) = 0.5_wp
    bubble = -1.5_wp*turn                      ! of sections with cores, which do not shear as a whole
    do l = 1, size(s%layers)
      if (s%cores == 0) then
        call add_bonded(s%layers(l))
      else
        call add_sliding(s%layers(l))
      end if
    end do
    x%rows = rows(1:n, :)
    x%stiffness = x%stiffness(1:n)
    x%ray_k = x%ray_k(1:n)
    x%layer = x%layer(1:n)
    x%material = x%material(1:n)
    x%angle = x%angle(1:n)
    x%shear = x%shear(1:n)
    x%strain = x%strain(:, 1:n)
    x%force = transpose(x%rows)*spread(x%stiffness, 1, x%deformations)
  contains
    !> A layer of a section without cores: both changes along the element follow the same deformation, as the shear does.
    subroutine add_bonded(layer)
      type(section_layer), intent(in) :: layer
      real(wp) :: bend, face(4)                ! [N m], [m]
      face = 0.5_wp*layer%thickness*[-1, 1, -1, 1]
      call add(stretch - layer%height*difference, layer%young*layer%area/x%length, one, layer%follows, .false.)
      call add(difference, layer%young*layer%second/x%length, -face, layer%follows, .true.)
      bend = layer%young*(layer%second + layer%area*(s%axis - layer%height)**2)/x%length
      bend = 12*(1 - x%softening)**2*bend + layer%shear*layer%area*x%length*x%softening**2
      call add(turn, bend, -6*(1 - x%softening)*ends*(s%axis - layer%height - face), layer%follows, .true.)
    end subroutine add_bonded

    !> A layer of a section with cores: means and changes of its strain and of its turn; of a core its angle at two points, as the
    !> third mode of a quadratic angle stores nothing.
    subroutine add_sliding(layer)
      type(section_layer), intent(in) :: layer
      real(wp), dimension(x%deformations) :: mean, change, mean_turn, change_turn, own   ! [-], [m]
      real(wp) :: face(4), xi                  ! [m], [-]
      integer :: j, p
      logical :: follows
      face = 0.5_wp*layer%thickness*[-1, 1, -1, 1]
      mean = stretch - layer%height*difference
      change = (s%axis - layer%height)*bubble
      mean_turn = difference
      change_turn = bubble
      do j = 1, s%cores
        p = 3 + 3*j
        mean(p - 2:p - 1) = s%arm(l, j)*[-1.0_wp, 1.0_wp]
        change(p) = s%arm(l, j) - s%axis_arm(j)
        if (j /= layer%core) cycle
        mean_turn(p - 2:p - 1) = [1.0_wp, -1.0_wp]
        change_turn(p) = -1.0_wp
      end do
      follows = layer%follows .and. (layer%core == 0 .or. s%core_stretch)
      call add(mean, layer%young*layer%area/x%length, one, follows, .false.)
      call add(4*change, layer%young*layer%area/x%length/3, ends, follows, .false.)
      call add(mean_turn, layer%young*layer%second/x%length, -face, follows, .true.)
      call add(4*change_turn, layer%young*layer%second/x%length/3, -face*ends, follows, .true.)
      if (layer%core == 0) return
      p = 3 + 3*layer%core
      do j = 1, 2
        xi = 0.5_wp + (j - 1.5_wp)/sqrt(3.0_wp)
        own = 0.0_wp
        own(p - 2:p) = [1 - xi, xi, 4*xi*(1 - xi)]
        call add(own, layer%shear*layer%area*x%length/2, 0*one, layer%follows, .true.)
        x%shear(n) = .true.
      end do
    end subroutine add_sliding

    !> Adds a row, unless nothing moves it.
    subroutine add(row, stiffness, strain, follows, angle)
      real(wp), intent(in) :: row(:)           !! [-], [m]
      real(wp), intent(in) :: stiffness        !! [N/m], [N m]
      real(wp), intent(in) :: strain(4)        !! of the faces at both ends, times the length [-], [m]
      logical, intent(in) :: follows           !! the layer's terms follow the row
      logical, intent(in) :: angle             !! the row is an angle
      if (.not. any(abs(row) > 0.0_wp)) return
      n = n + 1
      rows(n, :) = row
      x%stiffness(n) = stiffness
      x%ray_k(n) = s%layers(l)%ray_k
      x%layer(n) = l
      x%material(n) = merge(s%layers(l)%material, 0, follows)
      x%angle(n) = angle
      x%strain(:, n) = strain/x%length
      x%shear(n) = .false.
    end subroutine add
  end subroutine add_rows

  !> Integrals over the mass by Gauss' four points, which are exact (theory.md, sections 2 and 16). The spin sees the motion of the
  !> centre of mass alone: so the kinetic energy is a sum of squares.
  pure subroutine add_inertia(s, x)
    type(layered_section_model), intent(in) :: s
    type(layered_element_model), intent(inout) :: x
    real(wp), parameter :: points(2) = [0.339981043584856264802665759103_wp, 0.861136311594052575223946488893_wp]
    real(wp), parameter :: weights(2) = [0.652145154862546142626936050778_wp, 0.347854845137453857373063949222_wp]
    real(wp), dimension(x%coordinates) :: u, v, turn, half_turn, w, shift, own   ! rows [-], [m], [1/m]
    real(wp) :: middle(x%coordinates)          ! motion of the centre of mass along the axis [-]
    real(wp) :: xi, b, mass, inertia, m(x%coordinates, x%coordinates), r(x%coordinates, x%coordinates)
    integer :: k, l, j, n
    n = x%coordinates
    allocate (x%m(n, n), x%j(n, n), x%z(n, n), x%c(n, n), x%s(2, n), x%along(n), x%turning(n), source=0.0_wp)
    half_turn = 0.0_wp                         ! (phi1 + phi2)/2
    half_turn([2, 3, 5, 6]) = [1/x%length, 0.5_wp, -1/x%length, 0.5_wp]
    do k = 1, 4
      xi = 0.5_wp + sign(0.5_wp, k - 2.5_wp)*points(1 + mod(k, 2))
      b = 4*xi*(1 - xi)
      v = 0.0_wp                               ! cubic with the slopes r - softening (phi1 + phi2)/2 at its ends
      v([2, 3, 5, 6]) = [(1 - xi)**2*(1 + 2*xi), x%length*xi*(1 - xi)**2, xi**2*(3 - 2*xi), -x%length*xi**2*(1 - xi)]
      v = v - x%length*xi*(1 - xi)*(1 - 2*xi)*x%softening*half_turn
      turn = 0.0_wp                            ! v' + g~ = (1 - xi) r1 + xi r2 + q B
      turn([3, 6]) = [1 - xi, xi]
      turn = turn - 1.5_wp*(1 - x%softening)*b*half_turn
      u = 0.0_wp
      u([1, 4]) = [1 - xi, xi]
      u = u - 1.5_wp*(1 - x%softening)*b*s%axis*half_turn
      do j = 1, s%cores
        u(6 + 3*j) = -b*s%axis_arm(j)
      end do
      middle = 0.0_wp
      do l = 1, size(s%layers)
        middle = middle + s%layers(l)%density*s%layers(l)%area*moved(l)
      end do
      middle = middle/sum(s%layers%density*s%layers%area)
      do l = 1, size(s%layers)
        associate (layer => s%layers(l))
          mass = layer%density*layer%area*x%length*0.5_wp*weights(1 + mod(k, 2))
          inertia = layer%density*layer%turning*x%length*0.5_wp*weights(1 + mod(k, 2))
          own = turn
          if (layer%core > 0) own = own - angle(layer%core)
          w = moved(l)
          shift = w - middle
          m = mass*(outer(middle, middle) + outer(v, v))
          r = mass*outer(shift, shift) + inertia*outer(own, own)
          x%m = x%m + m
          x%j = x%j + r
          x%c = x%c + layer%ray_m*(mass*(outer(w, w) + outer(v, v)) + inertia*outer(own, own))
          x%z = x%z + mass*(outer(w, v) - outer(v, w))
          x%s(1, :) = x%s(1, :) + mass*w
          x%s(2, :) = x%s(2, :) + mass*v
          x%along = x%along + mass*(x%length*xi*w + layer%height*v)
          x%turning = x%turning + mass*(x%length*xi*v - layer%height*w) + inertia*own
          x%mass = x%mass + mass
          x%first = x%first + mass*layer%height
          x%second = x%second + mass*layer%height**2 + inertia
        end associate
      end do
    end do
  contains
    !> Motion along the axis of a layer's middle.
    pure function moved(layer) result(w)       ! [-]
      integer, intent(in) :: layer
      real(wp) :: w(n)
      integer :: j
      w = u - s%layers(layer)%height*turn
      do j = 1, s%cores
        w = w + s%arm(layer, j)*angle(j)
      end do
    end function moved

    !> Shear angle of a core.
    pure function angle(core) result(g)        ! [-]
      integer, intent(in) :: core
      real(wp) :: g(n)
      g = 0.0_wp
      g(4 + 3*core:6 + 3*core) = [1 - xi, xi, b]
    end function angle
  end subroutine add_inertia

  !> a b^T.
  pure function outer(a, b) result(m)
    real(wp), intent(in) :: a(:), b(:)         !! [any]
    real(wp) :: m(size(a), size(b))            !! [any]
    m = spread(a, 2, size(b))*spread(b, 1, size(a))
  end function outer
end module layered_element
