!> Section forces along an element (theory.md, section 18): those that its deformation asks for at its ends, and between them what
!> weight, inertia and damping by the mass, spread over it, add. The shapes of the displacements are polynomials of the share xi of
!> the element's length, so the courses are, too. Element axes; N and Q are what the part beyond a section does to the part before
!> it, along and across the undeformed element; M is positive where the upper fibre is pressed.
module section_forces
  use kinds, only: wp
  use beam_element, only: beam_geometry, deformation_matrix, element_rotation
  use body, only: body_model
  use layered_element, only: layered_element_model
  use layered_section, only: layered_section_model
  use unit_polynomials, only: antiderivative
  implicit none (type, external)
  private
  public :: add_courses, bonded_stress, course_of_deformation, course_of_loads, course_of_pull, difference, element_axes, &
            resultant_of_loads

  integer, parameter :: load_degree = 3
  integer, parameter, public :: course_degree = load_degree + 2   !! of the moment; a stress has it, too

  !> N, Q and M of an element.
  type, public :: section_course
    real(wp) :: n(0:course_degree) = 0.0_wp   !! [N]
    real(wp) :: q(0:course_degree) = 0.0_wp   !! [N]
    real(wp) :: m(0:course_degree) = 0.0_wp   !! [N m]
  end type section_course

  !> Motion of an element, or a change of it: the loads are linear in each of these.
  type, public :: element_motion
    real(wp) :: a(2) = 0.0_wp                 !! of the frame's origin less gravity, body axes [m/s2]
    real(wp) :: turn = 0.0_wp                 !! theta'' [1/s2]
    real(wp) :: coriolis = 0.0_wp             !! 2 theta' [1/s]
    real(wp) :: centrifugal = 0.0_wp          !! theta'^2 [1/s2]
    real(wp) :: place = 1.0_wp                !! 0: the undeformed place does not count [-]
    real(wp), allocatable :: q(:)             !! coordinates of the element, element axes [m, rad]
    real(wp), allocatable :: v(:)             !! their rates, in Coriolis' acceleration [m/s, rad/s]
    real(wp), allocatable :: damped(:)        !! the same, in Rayleigh damping
    real(wp), allocatable :: acceleration(:)  !! [m/s2, rad/s2]
  end type element_motion

  !> Displacements along an element, polynomials.
  type :: displacement_field
    real(wp) :: v(0:load_degree) = 0.0_wp     !! across [m]
    real(wp) :: u(0:load_degree) = 0.0_wp     !! along, of the node line [m]
    real(wp), allocatable :: w(:, :)          !! (0:3, layers) along, of a layer's middle [m]
    real(wp), allocatable :: turn(:, :)       !! (0:3, layers) turn of a layer [rad]
  end type displacement_field

contains

  !> Coordinates of an element in its own axes.
  pure function element_axes(b, e, x) result(a)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: x(:)              !! (coordinates or more) body axes [m, rad]
    real(wp), allocatable :: a(:)             !! [m, rad]
    a = x(:b%layers%kinds(b%layers%kind(e))%coordinates)
    a(:6) = matmul(element_rotation(b%elements(e)), a(:6))
  end function element_axes

  !> What the deformation asks for: N and Q are constant, M is linear.
  pure type(section_course) function course_of_deformation(length, f) result(x)
    real(wp), intent(in) :: length            !! [m]
    real(wp), intent(in) :: f(3)              !! conjugate to (e, phi1, phi2) [N], [N m]
    x%n(0) = f(1)
    x%q(0) = -(f(2) + f(3))/length
    x%m(0:1) = [-f(2), f(2) + f(3)]
  end function course_of_deformation

  !> What an axial force adds with stiffening: it acts along the deflected element. Nodes feel the mean over the element.
  pure type(section_course) function course_of_pull(b, e, force, x) result(course)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: force             !! [N]
    real(wp), intent(in) :: x(:)              !! coordinates, element axes [m, rad]
    type(displacement_field) :: at
    real(wp) :: psi, slope(2), m(2)           ! turn of the chord, those of the ends against it [rad], [N m]
    if (.not. b%stiffening) return
    associate (g => b%elements(e))
      at = field_of(b, e, x)
      psi = (x(5) - x(2))/g%length
      slope = [x(3), x(6)] - psi
      slope = slope - 0.5_wp*g%softening*sum(slope)
      m = force*g%length/30*[4*slope(1) - slope(2), 4*slope(2) - slope(1)]
      m = m - 0.5_wp*g%softening*sum(m)
      course%q(0) = force*psi - sum(m)/g%length
      course%m(0:1) = [-m(1), -g%length*course%q(0)]
      course%m(1:load_degree) = course%m(1:load_degree) + force*at%v(1:)
    end associate
  end function course_of_pull

  !> What loads spread over the element add where its nodes carry them as the equations of motion say, or from given forces and a
  !> moment at its first end.
  pure type(section_course) function course_of_loads(b, e, motion, first) result(x)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    type(element_motion), intent(in) :: motion
    real(wp), intent(in), optional :: first(3)   !! N, Q, M [N], [N m]
    real(wp) :: load(0:load_degree, 3)
    load = loads(b, e, motion)
    if (present(first)) then
      x%n(0) = first(1)
      x%q(0) = first(2)
      x%m(0) = first(3)
    else
      associate (f => nodal_loads(b, e, motion))
        x%n(0) = -f(1)
        x%q(0) = -f(2)
        x%m(0) = -f(3)
      end associate
    end if
    associate (l => b%elements(e)%length, n => load_degree + 1)
      x%n(:n) = x%n(:n) - l*antiderivative(load(:, 1))
      x%q(:n) = x%q(:n) - l*antiderivative(load(:, 2))
      x%m = x%m - l*antiderivative(x%q(:n) + [load(:, 3), 0.0_wp])
    end associate
  end function course_of_loads

  !> The sum of two courses.
  elemental type(section_course) function add_courses(a, b) result(x)
    type(section_course), intent(in) :: a, b
    x%n = a%n + b%n
    x%q = a%q + b%q
    x%m = a%m + b%m
  end function add_courses

  !> One less another.
  elemental type(section_course) function difference(a, b) result(x)
    type(section_course), intent(in) :: a, b
    x%n = a%n - b%n
    x%q = a%q - b%q
    x%m = a%m - b%m
  end function difference

  !> Resultant of the loads on an element: forces, and the moment about its first end.
  pure function resultant_of_loads(b, e, motion) result(total)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    type(element_motion), intent(in) :: motion
    real(wp) :: total(3)                      !! [N], [N m]
    type(section_course) :: x
    x = course_of_loads(b, e, motion, [0.0_wp, 0.0_wp, 0.0_wp])
    total(1:2) = -[sum(x%n), sum(x%q)]
    total(3) = -sum(x%m) + b%elements(e)%length*total(2)
  end function resultant_of_loads

  !> Stress that a layer bonded to the others takes of N and M, at a height above the node line.
  pure function bonded_stress(s, layer, height, x) result(stress)
    type(layered_section_model), intent(in) :: s
    integer, intent(in) :: layer
    real(wp), intent(in) :: height            !! [m]
    type(section_course), intent(in) :: x
    real(wp) :: stress(0:course_degree)       !! [Pa]
    stress = s%layers(layer)%young*(x%n/s%stretching - (x%m + s%axis*x%n)*(height - s%axis)/s%bending)
  end function bonded_stress

  !> Displacements along an element (theory.md, section 16).
  pure type(displacement_field) function field_of(b, e, x) result(at)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: x(:)              !! coordinates, element axes [m, rad]
    real(wp), parameter :: bubble(0:load_degree) = [0.0_wp, 4.0_wp, -4.0_wp, 0.0_wp]
    real(wp) :: mean, slope(2), own(0:load_degree)   ! (phi1 + phi2)/2, end slopes of the node line [rad]
    integer :: l, j, p
    associate (g => b%elements(e), s => b%layers%sections(b%layers%kinds(b%layers%kind(e))%section))
      mean = 0.5_wp*(x(3) + x(6)) - (x(5) - x(2))/g%length
      slope = g%length*([x(3), x(6)] - g%softening*mean)
      at%v = [x(2), slope(1), 3*(x(5) - x(2)) - 2*slope(1) - slope(2), 2*(x(2) - x(5)) + slope(1) + slope(2)]
      at%u = linear(x(1), x(4)) - 1.5_wp*(1 - g%softening)*mean*s%axis*bubble
      do j = 1, s%cores
        at%u = at%u - x(6 + 3*j)*s%axis_arm(j)*bubble
      end do
      allocate (at%w(0:load_degree, size(s%layers)), at%turn(0:load_degree, size(s%layers)))
      do l = 1, size(s%layers)
        at%turn(:, l) = linear(x(3), x(6)) - 1.5_wp*(1 - g%softening)*mean*bubble
        at%w(:, l) = at%u - s%layers(l)%height*at%turn(:, l)
        do j = 1, s%cores
          p = 6 + 3*j
          own = linear(x(p - 2), x(p - 1)) + x(p)*bubble
          at%w(:, l) = at%w(:, l) + s%arm(l, j)*own
          if (s%layers(l)%core == j) at%turn(:, l) = at%turn(:, l) - own
        end do
      end do
    end associate
  contains
    !> From a value at the first end to one at the other.
    pure function linear(first, last) result(c)
      real(wp), intent(in) :: first, last     !! [m] or [rad]
      real(wp) :: c(0:load_degree)            !! [m] or [rad]
      c = [first, last - first, 0.0_wp, 0.0_wp]
    end function linear
  end function field_of

  !> Forces along and across the element per length, and the moment about the node line per length: weight, inertia and Rayleigh
  !> damping by the mass. Of the layers' own shift the spin knows no inertia (theory.md, section 16).
  pure function loads(b, e, motion) result(load)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    type(element_motion), intent(in) :: motion
    real(wp) :: load(0:load_degree, 3)        !! [N/m], [N]
    type(displacement_field) :: q, v, damped, acceleration
    real(wp), dimension(0:load_degree) :: x, y, ax, ay, drag   ! undeformed place [m], accelerations, those of damping [m/s2]
    real(wp) :: a(2), start(2), density       ! element axes [m/s2], [m], [kg/m]
    integer :: l
    q = field_of(b, e, motion%q)
    v = field_of(b, e, motion%v)
    damped = field_of(b, e, motion%damped)
    acceleration = field_of(b, e, motion%acceleration)
    a = along_element(b%elements(e), motion%a)
    start = along_element(b%elements(e), b%x(:, b%en(1, e)))
    load = 0.0_wp
    x = motion%place*[start(1), b%elements(e)%length, 0.0_wp, 0.0_wp]
    associate (s => b%layers%sections(b%layers%kinds(b%layers%kind(e))%section))
      do l = 1, size(s%layers)
        associate (layer => s%layers(l))
          density = layer%density*layer%area
          y = motion%place*[start(2) + layer%height, 0.0_wp, 0.0_wp, 0.0_wp]
          ax = acceleration%w(:, l) - motion%turn*(y + q%v) - motion%coriolis*v%v - motion%centrifugal*(x + q%w(:, l))
          ay = acceleration%v + motion%turn*(x + q%w(:, l)) + motion%coriolis*v%w(:, l) - motion%centrifugal*(y + q%v)
          ax(0) = ax(0) + a(1)
          ay(0) = ay(0) + a(2)
          drag = layer%ray_m*damped%w(:, l)
          load(:, 1) = load(:, 1) - density*(ax + drag)
          load(:, 2) = load(:, 2) - density*(ay + layer%ray_m*damped%v)
          ax = ax + motion%centrifugal*(q%w(:, l) - q%u)
          load(:, 3) = load(:, 3) + density*layer%height*(ax + drag)
          ax = acceleration%turn(:, l) + layer%ray_m*damped%turn(:, l)
          ax(0) = ax(0) + motion%place*motion%turn
          load(:, 3) = load(:, 3) - layer%density*layer%turning*ax
        end associate
      end do
    end associate
  end function loads

  !> What the nodes carry of these loads, with the sign of inertia: the element's part of the equations of motion.
  pure function nodal_loads(b, e, motion) result(f)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    type(element_motion), intent(in) :: motion
    real(wp), allocatable :: f(:)             !! element axes [N], [N m]
    real(wp) :: a(2), start(2)                ! element axes [m/s2], [m]
    a = along_element(b%elements(e), motion%a)
    start = along_element(b%elements(e), b%x(:, b%en(1, e)))
    associate (k => b%layers%kinds(b%layers%kind(e)))
      f = matmul(a + motion%place*(motion%turn*[-start(2), start(1)] - motion%centrifugal*start), k%s) &
          + motion%place*(motion%turn*k%turning - motion%centrifugal*k%along) &
          - matmul(k%z, motion%turn*motion%q + motion%coriolis*motion%v) - motion%centrifugal*matmul(k%m, motion%q) &
          + matmul(k%m + k%j, motion%acceleration) + matmul(k%c, motion%damped)
    end associate
  end function nodal_loads

  !> A vector of body axes in element axes.
  pure function along_element(g, x) result(y)
    type(beam_geometry), intent(in) :: g
    real(wp), intent(in) :: x(2)              !! [any]
    real(wp) :: y(2)                          !! [any]
    y = [g%c*x(1) + g%s*x(2), g%c*x(2) - g%s*x(1)]
  end function along_element
end module section_forces
