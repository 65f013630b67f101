!> Section forces at both ends of an element and, where its section has a shape, the stresses of its outer fibres (input/README.md,
!> 'internal'); the largest stress of a body, and its place.
module section_sensors
  use kinds, only: wp
  use element_courses, only: course_amplitudes, element_course, outer_amplitudes, outer_forces, present_course
  use section_forces, only: course_degree
  use sensor, only: observation, sensor_model, harmonic_motion
  use unit_polynomials, only: largest_at, product_of, value_at
  implicit none (type, external)
  private
  public :: place_of

  real(wp), parameter :: same = 1.0e-9_wp     !! stresses that differ by less, of their size, are one: the first place counts [-]

  !> Stresses of an upper and a lower fibre along an element, polynomials: of a state, or real and imaginary parts of amplitudes.
  type, public :: fibre_stresses
    real(wp), allocatable :: c(:, :, :)       !! (0:course_degree, upper and lower, parts) [Pa]
  contains
    procedure :: at => stresses_at
    procedure :: largest => largest_along
  end type fibre_stresses

  !> An element's section forces, those of a run of elements where a finer mesh stands for the deck's.
  type, extends(sensor_model), public :: section_sensor_model
    integer :: first = 0                      !! element
    integer :: last = 0                       !! the same, or the last one of a run
    real(wp) :: along = -1.0_wp               !! place of the stresses, 0 to 1; below 0: where they are largest [-]
    logical :: balanced = .false.             !! forces are those of equilibrium (`element_courses`)
  contains
    procedure :: read => read_section
    procedure :: respond
  end type section_sensor_model

  !> A body's largest stress over the elements whose sections have a shape, and its place.
  type, extends(sensor_model), public :: stress_sensor_model
    logical :: balanced = .false.             !! forces are those of equilibrium (`element_courses`)
  contains
    procedure :: read => read_stress
  end type stress_sensor_model

contains

  !> As evaluated.
  subroutine read_section(self, at, x)
    class(section_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! as of `columns_of` [N], [N m], [Pa], [-]
    real(wp), allocatable :: outer(:, :)      ! [N], [N m]
    type(element_course) :: course(self%last - self%first + 1, 1)
    complex(wp) :: values(10)
    integer :: e
    if (self%balanced) outer = outer_forces(at, self%marker%body)
    do e = self%first, self%last
      course(e - self%first + 1, 1) = course_of(at, self%marker%body, e, outer)
    end do
    values = columns_of(at, self, course)
    e = merge(10, 6, at%m%s%bodies(self%marker%body)%elements(self%first)%fibre > 0.0_wp)
    x(:e) = real(values(:e), wp)
  end subroutine read_section

  !> The course of an element, with outer forces where these are known.
  function course_of(at, body, e, outer) result(course)
    type(observation), intent(in) :: at
    integer, intent(in) :: body               !! number of the body
    integer, intent(in) :: e                  !! element
    real(wp), intent(in), allocatable :: outer(:, :)   !! [N], [N m]
    type(element_course) :: course
    if (allocated(outer)) then
      course = present_course(at, body, e, outer(:, e))
    else
      course = present_course(at, body, e)
    end if
  end function course_of

  !> With the material's modulus at s; the stresses are those where the amplitude is largest.
  subroutine respond(self, at, motion, x)
    class(section_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! as of `columns_of` [N], [N m], [Pa], [-]
    type(element_course) :: course(self%last - self%first + 1, 2)
    real(wp), allocatable :: outer(:, :, :)   ! [N], [N m]
    complex(wp) :: values(10)
    integer :: e
    if (self%balanced) outer = outer_amplitudes(at, motion, self%marker%body)
    do e = self%first, self%last
      if (self%balanced) then
        course(e - self%first + 1, :) = course_amplitudes(at, motion, self%marker%body, e, outer(:, e, :))
      else
        course(e - self%first + 1, :) = course_amplitudes(at, motion, self%marker%body, e)
      end if
    end do
    values = columns_of(at, self, course)
    e = merge(10, 6, at%m%s%bodies(self%marker%body)%elements(self%first)%fibre > 0.0_wp)
    x(:e) = values(:e)
  end subroutine respond

  !> n q m1 m2 n2 q2, or with a shape n q m1 m2 s n2 q2 top bottom along.
  function columns_of(at, self, course) result(x)
    type(observation), intent(in) :: at
    class(section_sensor_model), intent(in) :: self
    type(element_course), intent(in) :: course(:, :)   !! (elements, parts)
    complex(wp) :: x(10)                      !! [N], [N m], [Pa], [-]
    type(fibre_stresses) :: fibres(size(course, 1))
    integer :: e, k, n
    real(wp) :: place                         ! [-]
    x = 0.0_wp
    n = size(course, 1)
    x(1) = joined(course(1, :)%all%n(0))
    x(2) = joined(course(1, :)%all%q(0) + course(1, :)%lean(1))
    x(3) = joined(course(1, :)%all%m(0))
    x(4) = joined([(sum(course(n, k)%all%m), k=1, size(course, 2))])
    x(5) = joined([(sum(course(n, k)%all%n), k=1, size(course, 2))])
    x(6) = joined([(sum(course(n, k)%all%q) + course(n, k)%lean(2), k=1, size(course, 2))])
    if (.not. at%m%s%bodies(self%marker%body)%elements(self%first)%fibre > 0.0_wp) return
    do e = 1, n
      fibres(e) = stresses_of(at, self%marker%body, self%first + e - 1, course(e, :))
    end do
    call place_of(fibres, self%along, e, place)
    x(6:7) = x(5:6)
    x(8:9) = fibres(e)%at(place)
    x(5) = x(merge(8, 9, abs(x(8)) >= abs(x(9))))
    if (size(course, 2) == 1) x(5) = abs(x(5))
    x(10) = (e - 1 + place)/n
    if (size(course, 2) > 1) x(10) = 0.0_wp   ! no amplitude
  end function columns_of

  !> A number of its parts.
  pure complex(wp) function joined(parts)     ! [any]
    real(wp), intent(in) :: parts(:)          !! real, and imaginary if any [any]
    joined = parts(1)
    if (size(parts) > 1) joined = cmplx(parts(1), parts(2), wp)
  end function joined

  !> Stresses of the outer fibres.
  function stresses_of(at, body, e, course) result(x)
    type(observation), intent(in) :: at
    integer, intent(in) :: body               !! number of the body
    integer, intent(in) :: e                  !! element
    type(element_course), intent(in) :: course(:)   !! (parts)
    type(fibre_stresses) :: x
    integer :: k
    allocate (x%c(0:course_degree, 2, size(course)))
    associate (g => at%m%s%bodies(body)%elements(e))
      do k = 1, size(course)
        associate (by_n => course(k)%all%n/g%area, by_m => course(k)%all%m*(g%fibre/g%second))
          x%c(:, 1, k) = by_n - by_m
          x%c(:, 2, k) = by_n + by_m
        end associate
      end do
    end associate
  end function stresses_of

  !> Both at a place.
  pure function stresses_at(self, place) result(x)
    class(fibre_stresses), intent(in) :: self
    real(wp), intent(in) :: place             !! [-]
    complex(wp) :: x(2)                       !! [Pa]
    integer :: f, k
    do f = 1, 2
      x(f) = joined([(value_at(self%c(:, f, k), place), k=1, size(self%c, 3))])
    end do
  end function stresses_at

  !> Where the larger of both is largest.
  pure real(wp) function largest_along(self) result(place)   ! [-]
    class(fibre_stresses), intent(in) :: self
    real(wp) :: at(2)                         ! [-]
    integer :: f
    do f = 1, 2
      if (size(self%c, 3) == 1) then
        at(f) = largest_at(self%c(:, f, 1))
      else
        at(f) = largest_at(product_of(self%c(:, f, 1), self%c(:, f, 1)) + product_of(self%c(:, f, 2), self%c(:, f, 2)))
      end if
    end do
    place = at(1)
    if (maxval(abs(self%at(at(2)))) > (1 + same)*maxval(abs(self%at(at(1))))) place = at(2)
  end function largest_along

  !> Element and place of the largest stress of a run of elements of one length, or of a share of their length.
  pure subroutine place_of(fibres, along, e, place)
    type(fibre_stresses), intent(in) :: fibres(:)   !! of the elements
    real(wp), intent(in) :: along             !! share; below 0: where the stress is largest [-]
    integer, intent(out) :: e
    real(wp), intent(out) :: place            !! share of that element [-]
    real(wp) :: largest, found, x             ! [Pa], [Pa], [-]
    integer :: k
    call find_along(along, size(fibres), e, place)
    if (along >= 0.0_wp) return
    largest = -1.0_wp
    do k = 1, size(fibres)
      x = fibres(k)%largest()
      found = maxval(abs(fibres(k)%at(x)))
      if (found <= (1 + same)*largest) cycle
      largest = found
      e = k
      place = x
    end do
  end subroutine place_of

  !> The element of a run in which a share of the length of all lies, and the share of its own.
  pure subroutine find_along(along, n, e, place)
    real(wp), intent(in) :: along             !! [-]
    integer, intent(in) :: n                  !! elements
    integer, intent(out) :: e
    real(wp), intent(out) :: place            !! [-]
    e = max(1, min(n, 1 + int(along*n)))
    place = along*n - (e - 1)
  end subroutine find_along

  !> As evaluated.
  subroutine read_stress(self, at, x)
    class(stress_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! s element node along top bottom [Pa], [-]
    real(wp), allocatable :: outer(:, :)      ! [N], [N m]
    type(fibre_stresses) :: fibres
    real(wp) :: place, both(2)                ! [-], [Pa]
    integer :: e
    if (self%balanced) outer = outer_forces(at, self%marker%body)
    x(1:6) = -1.0_wp
    associate (body => at%m%s%bodies(self%marker%body))
      do e = 1, body%ne
        if (.not. body%elements(e)%fibre > 0.0_wp) cycle
        fibres = stresses_of(at, self%marker%body, e, [course_of(at, self%marker%body, e, outer)])
        place = fibres%largest()
        both = real(fibres%at(place), wp)
        if (maxval(abs(both)) <= (1 + same)*x(1)) cycle
        x(1:6) = [maxval(abs(both)), real(e, wp), real(body%en(merge(1, 2, place <= 0.5_wp), e), wp), place, both]
      end do
    end associate
  end subroutine read_stress
end module section_sensors
