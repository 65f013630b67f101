!> Layers of beams: stresses of both faces of one in an element, of a core the shear stresses; the shear angles of cores at a node.
module layer_sensors
  use kinds, only: wp
  use body, only: body_model
  use element_courses, only: course_amplitudes, element_course, outer_amplitudes, outer_forces, part, &
                             present_course
  use section_forces, only: bonded_stress, course_degree, difference
  use section_sensors, only: fibre_stresses, place_of
  use sensor, only: harmonic_motion, observation, sensor_model
  implicit none (type, external)
  private

  !> Stresses of a layer of an element.
  type, extends(sensor_model), public :: layer_sensor_model
    integer :: first = 0                      !! element
    integer :: last = 0                       !! the same, or the last one of a run where a finer mesh stands for the deck's
    integer :: layer = 0
    logical :: core = .false.
    real(wp) :: along = -1.0_wp               !! place of the stresses, 0 to 1; below 0: where they are largest [-]
    logical :: balanced = .false.             !! the axial force is that of equilibrium (`element_courses`)
  contains
    procedure :: read => read_layer
    procedure :: respond => layer_amplitude
  end type layer_sensor_model

  !> Shear angles of the body's cores at a node; 0 where no element beside it has the core.
  type, extends(sensor_model), public :: slip_sensor_model
    integer, allocatable :: element(:), entry(:)   !! (cores) an element that has it, 0: none; its place among the coordinates
  contains
    procedure :: find
    procedure :: angles
    procedure :: read => read_slip
    procedure :: respond => slip_amplitude
  end type slip_sensor_model

contains

  !> As evaluated.
  subroutine read_layer(self, at, x)
    class(layer_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! as of `columns_of` [Pa], [-]
    type(element_course) :: course(self%last - self%first + 1, 1)
    real(wp), allocatable :: outer(:, :)      ! [N], [N m]
    complex(wp) :: values(7)
    integer :: e
    if (self%balanced) outer = outer_forces(at, self%marker%body)
    do e = 1, size(course)
      if (self%balanced) then
        course(e, 1) = present_course(at, self%marker%body, self%first + e - 1, outer(:, self%first + e - 1))
      else
        course(e, 1) = present_course(at, self%marker%body, self%first + e - 1)
      end if
    end do
    values = columns_of(at%m%s%bodies(self%marker%body), self, course)
    e = merge(7, 4, self%core)
    x(:e) = real(values(:e), wp)
  end subroutine read_layer

  !> Where the amplitudes are largest.
  subroutine layer_amplitude(self, at, motion, x)
    class(layer_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! as of `columns_of` [Pa], [-]
    type(element_course) :: course(self%last - self%first + 1, 2)
    real(wp), allocatable :: outer(:, :, :)   ! [N], [N m]
    complex(wp) :: values(7)
    integer :: e
    if (self%balanced) outer = outer_amplitudes(at, motion, self%marker%body)
    do e = 1, size(course, 1)
      if (self%balanced) then
        course(e, :) = course_amplitudes(at, motion, self%marker%body, self%first + e - 1, outer(:, self%first + e - 1, :))
      else
        course(e, :) = course_amplitudes(at, motion, self%marker%body, self%first + e - 1)
      end if
    end do
    values = columns_of(at%m%s%bodies(self%marker%body), self, course)
    e = merge(7, 4, self%core)
    x(:e) = values(:e)
  end subroutine layer_amplitude

  !> s top bottom along, or of a core s tau top bottom along tau1 tau2.
  function columns_of(b, self, course) result(x)
    type(body_model), intent(in) :: b
    class(layer_sensor_model), intent(in) :: self
    type(element_course), intent(in) :: course(:, :)   !! (elements, parts)
    complex(wp) :: x(7)                       !! [Pa], [-]
    type(fibre_stresses) :: faces(size(course, 1))
    complex(wp) :: tau(2*size(course, 1))     ! [Pa]
    real(wp) :: place                         ! [-]
    integer :: e, n
    x = 0.0_wp
    n = size(course, 1)
    do e = 1, n
      call stresses(b, self, self%first + e - 1, course(e, :), faces(e), tau(2*e - 1:2*e))
    end do
    call place_of(faces, self%along, e, place)
    x(2:3) = faces(e)%at(place)
    x(1) = x(merge(2, 3, abs(x(2)) >= abs(x(3))))
    if (size(course, 2) == 1) x(4) = (e - 1 + place)/n
    if (self%core) then
      x(3:5) = x(2:4)
      x(2) = tau(maxloc(abs(tau), 1))
      x(6:7) = tau([1, 2*n])
    end if
    if (size(course, 2) == 1) x(1:merge(2, 1, self%core)) = abs(x(1:merge(2, 1, self%core)))
  end function columns_of

  !> Stresses of the upper and the lower face along an element, and shear stresses at a core's two points. What the deformation does
  !> not ask for the layers take as if all were bonded: within an element they do not slip by more.
  subroutine stresses(b, sensor, e, course, faces, tau)
    type(body_model), intent(in) :: b
    class(layer_sensor_model), intent(in) :: sensor
    integer, intent(in) :: e                  !! element
    type(element_course), intent(in) :: course(:)   !! (parts)
    type(fibre_stresses), intent(out) :: faces
    complex(wp), intent(out) :: tau(2)        !! [Pa]
    complex(wp) :: ends(4)                    ! lower and upper face at both ends [Pa]
    integer :: i, k, f, n
    ends = 0.0_wp
    tau = 0.0_wp
    n = 0
    allocate (faces%c(0:course_degree, 2, size(course)))
    associate (kind => b%layers%kinds(b%layers%kind(e)), d => course(1)%rows)
      associate (section => b%layers%sections(kind%section))
        associate (layer => section%layers(sensor%layer))
          do i = 1, size(d)
            if (kind%layer(i) /= sensor%layer) cycle
            ends = ends + layer%young*kind%strain(:, i)*d(i)
            if (.not. kind%shear(i)) cycle
            n = n + 1
            tau(n) = layer%shear*d(i)
          end do
          do k = 1, size(course)
            do f = 1, 2                        ! upper, lower
              faces%c(:, f, k) = bonded_stress(section, sensor%layer, layer%height + (1.5_wp - f)*layer%thickness, &
                                               difference(course(k)%all, course(k)%elastic))
              associate (first => part(ends(3 - f), k), last => part(ends(5 - f), k))
                faces%c(0:1, f, k) = faces%c(0:1, f, k) + [first, last - first]
              end associate
            end do
          end do
        end associate
      end associate
    end associate
  end subroutine stresses

  !> Finds where the cores' angles at a node stand.
  pure subroutine find(self, b, node)
    class(slip_sensor_model), intent(inout) :: self
    type(body_model), intent(in) :: b
    integer, intent(in) :: node
    integer :: e, i, j
    self%element = spread(0, 1, size(b%dof, 1) - 3)
    self%entry = self%element
    do e = 1, b%ne
      do i = 1, 2
        if (b%en(i, e) /= node) cycle
        associate (slot => b%layers%slot(:, b%layers%kinds(b%layers%kind(e))%section))
          do j = 1, size(slot)
            if (slot(j) == 0) cycle
            self%element(slot(j)) = e
            self%entry(slot(j)) = 3 + 3*j + i
          end do
        end associate
      end do
    end do
  end subroutine find

  !> From the elastic coordinates.
  subroutine read_slip(self, at, x)
    class(slip_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! (cores) [rad]
    associate (i => at%m%s%qo(self%marker%body) + 3, n => at%m%s%bodies(self%marker%body)%nf)
      x(:size(self%entry)) = self%angles(at%m%s%bodies(self%marker%body), at%y(i + 1:i + n))
    end associate
  end subroutine read_slip

  !> The same of amplitudes.
  subroutine slip_amplitude(self, at, motion, x)
    class(slip_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! (cores) [rad]
    associate (i => at%m%s%qo(self%marker%body) + 3, b => at%m%s%bodies(self%marker%body))
      x(:size(self%entry)) = cmplx(self%angles(b, real(motion%x(i + 1:i + b%nf), wp)), &
                                   self%angles(b, aimag(motion%x(i + 1:i + b%nf))), wp)
    end associate
  end subroutine slip_amplitude

  !> Angles by elastic coordinates.
  pure function angles(self, b, qf) result(g)
    class(slip_sensor_model), intent(in) :: self
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: qf(:)             !! (nf) [m, rad]
    real(wp) :: g(size(self%entry))           !! [rad]
    real(wp) :: a(size(b%edof, 1))            ! [m, rad]
    integer :: j
    g = 0.0_wp
    do j = 1, size(g)
      if (self%element(j) == 0) cycle
      a = b%basis%element_coordinates(b, self%element(j), qf)
      g(j) = a(self%entry(j))
    end do
  end function angles
end module layer_sensors
