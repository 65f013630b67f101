!> Section forces along an element (theory.md, section 18): those that its deformation asks for at its ends, and between them what
!> weight, inertia and damping by the mass, spread over it, add. The shapes of the displacements are polynomials of the share xi of
!> the element's length, so the courses are, too. Element axes; N and Q are what the part beyond a section does to the part before
!> it, along and across the undeformed element; M is positive where the upper fibre is pressed.
module section_forces
  use kinds, only: wp
  use beam_element, only: beam_geometry
  use body, only: body_model
  use layered_element, only: most_coordinates
  use layered_section, only: layered_section_model, most_cores
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
    real(wp) :: q(most_coordinates) = 0.0_wp  !! coordinates of the element, element axes [m, rad]
    real(wp) :: v(most_coordinates) = 0.0_wp  !! their rates, in Coriolis' acceleration [m/s, rad/s]
    real(wp) :: damped(most_coordinates) = 0.0_wp   !! the same, in Rayleigh damping [m/s, rad/s]
    real(wp) :: acceleration(most_coordinates) = 0.0_wp   !! [m/s2, rad/s2]
  end type element_motion

  !> Displacements along an element, polynomials.
  type :: displacement_field
    real(wp) :: v(0:load_degree) = 0.0_wp     !! across [m]
    real(wp) :: u(0:load_degree) = 0.0_wp     !! along, of the node line [m]
    real(wp) :: turn(0:load_degree) = 0.0_wp  !! of the section [rad]
    real(wp) :: slip(0:load_degree, most_cores) = 0.0_wp   !! shear angles of cores [rad]
  end type displacement_field

contains

  !> Coordinates of an element in its own axes.
  pure function element_axes(b, e, x) result(a)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: x(:)              !! (coordinates or more) body axes [m, rad]
    real(wp) :: a(most_coordinates)           !! [m, rad]
    integer :: n
    n = b%layers%kinds(b%layers%kind(e))%coordinates
    a(n + 1:) = 0.0_wp
    a(:n) = x(:n)
    a(1:2) = along_element(b%elements(e), x(1:2))
    a(4:5) = along_element(b%elements(e), x(4:5))
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
    real(wp) :: mean, slope(2)                ! (phi1 + phi2)/2, end slopes of the node line [rad]
    integer :: j, p
    associate (g => b%elements(e), s => b%layers%sections(b%layers%kinds(b%layers%kind(e))%section))
      mean = 0.5_wp*(x(3) + x(6)) - (x(5) - x(2))/g%length
      slope = g%length*([x(3), x(6)] - g%softening*mean)
      at%v = [x(2), slope(1), 3*(x(5) - x(2)) - 2*slope(1) - slope(2), 2*(x(2) - x(5)) + slope(1) + slope(2)]
      at%u = linear(x(1), x(4)) - 1.5_wp*(1 - g%softening)*mean*s%axis*bubble
      at%turn = linear(x(3), x(6)) - 1.5_wp*(1 - g%softening)*mean*bubble
      do j = 1, s%cores
        p = 6 + 3*j
        at%u = at%u - x(p)*s%axis_arm(j)*bubble
        at%slip(:, j) = linear(x(p - 2), x(p - 1)) + x(p)*bubble
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

  !> Displacement along of a layer's middle.
  pure function layer_along(at, s, l) result(w)
    type(displacement_field), intent(in) :: at
    type(layered_section_model), intent(in) :: s
    integer, intent(in) :: l                  !! layer
    real(wp) :: w(0:load_degree)              !! [m]
    integer :: j
    w = at%u - s%layers(l)%height*at%turn
    do j = 1, s%cores
      w = w + s%arm(l, j)*at%slip(:, j)
    end do
  end function layer_along

  !> Its turn.
  pure function layer_turn(at, s, l) result(turn)
    type(displacement_field), intent(in) :: at
    type(layered_section_model), intent(in) :: s
    integer, intent(in) :: l                  !! layer
    real(wp) :: turn(0:load_degree)           !! [rad]
    turn = at%turn
    if (s%layers(l)%core > 0) turn = turn - at%slip(:, s%layers(l)%core)
  end function layer_turn

  !> Forces along and across the element per length, and the moment about the node line per length: weight, inertia and Rayleigh
  !> damping by the mass. Of layers' shift against the centre of mass the spin knows no inertia (theory.md, section 16).
  pure function loads(b, e, motion) result(load)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    type(element_motion), intent(in) :: motion
    real(wp) :: load(0:load_degree, 3)        !! [N/m], [N]
    type(displacement_field) :: q, v, damped, acceleration
    real(wp), dimension(0:load_degree) :: x, y, w, ax, ay, drag   ! undeformed place, q along [m], accelerations, of damping [m/s2]
    real(wp) :: middle(0:load_degree)         ! motion of the centre of mass along [m]
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
      middle = 0.0_wp
      do l = 1, size(s%layers)
        middle = middle + s%layers(l)%density*s%layers(l)%area*layer_along(q, s, l)
      end do
      middle = middle/sum(s%layers%density*s%layers%area)
      do l = 1, size(s%layers)
        associate (layer => s%layers(l))
          density = layer%density*layer%area
          y = motion%place*[start(2) + layer%height, 0.0_wp, 0.0_wp, 0.0_wp]
          w = layer_along(q, s, l)
          ax = layer_along(acceleration, s, l) - motion%turn*(y + q%v) - motion%coriolis*v%v - motion%centrifugal*(x + w)
          ay = acceleration%v + motion%turn*(x + w) + motion%coriolis*layer_along(v, s, l) - motion%centrifugal*(y + q%v)
          ax(0) = ax(0) + a(1)
          ay(0) = ay(0) + a(2)
          drag = layer%ray_m*layer_along(damped, s, l)
          load(:, 1) = load(:, 1) - density*(ax + drag)
          load(:, 2) = load(:, 2) - density*(ay + layer%ray_m*damped%v)
          ax = ax + motion%centrifugal*(w - middle)
          load(:, 3) = load(:, 3) + density*layer%height*(ax + drag)
          ax = layer_turn(acceleration, s, l) + layer%ray_m*layer_turn(damped, s, l)
          ax(0) = ax(0) + motion%place*motion%turn
          load(:, 3) = load(:, 3) - layer%density*layer%turning*ax
        end associate
      end do
    end associate
  end function loads

  !> What the first node carries of these loads, with the sign of inertia: the element's part of the equations of motion.
  pure function nodal_loads(b, e, motion) result(f)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    type(element_motion), intent(in) :: motion
    real(wp) :: f(3)                          !! element axes [N], [N m]
    real(wp) :: a(2), start(2)                ! element axes [m/s2], [m]
    integer :: i, n
    a = along_element(b%elements(e), motion%a)
    start = along_element(b%elements(e), b%x(:, b%en(1, e)))
    associate (k => b%layers%kinds(b%layers%kind(e)))
      n = k%coordinates
      a = a + motion%place*(motion%turn*[-start(2), start(1)] - motion%centrifugal*start)
      do i = 1, 3
        f(i) = dot_product(a, k%s(:, i)) + motion%place*(motion%turn*k%turning(i) - motion%centrifugal*k%along(i)) &
               - dot_product(k%z(i, :), motion%turn*motion%q(:n) + motion%coriolis*motion%v(:n)) &
               + dot_product(k%m(i, :), motion%acceleration(:n) - motion%centrifugal*motion%q(:n)) &
               + dot_product(k%j(i, :), motion%acceleration(:n)) + dot_product(k%c(i, :), motion%damped(:n))
      end do
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
