!> Layers of beams: the largest stress of one in an element, of a core the largest shear stress; the shear angles of cores at
!> a node.
module layer_sensors
  use kinds, only: wp
  use body, only: body_model
  use section_sensors, only: present_rows, row_amplitudes
  use sensor, only: harmonic_motion, observation, sensor_model
  implicit none (type, external)
  private

  !> Stresses of a layer of an element.
  type, extends(sensor_model), public :: layer_sensor_model
    integer :: element = 0
    integer :: layer = 0
    logical :: core = .false.
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

  !> From the rows of the last evaluation; strains are linear between the faces and between the ends.
  subroutine read_layer(self, at, x)
    class(layer_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! stress, of a core shear stress [Pa]
    complex(wp) :: stress(6)
    stress = stresses(at%m%s%bodies(self%marker%body), self, cmplx(present_rows(at, self%marker%body, self%element), kind=wp))
    x(1) = maxval(abs(real(stress(1:4))))
    if (self%core) x(2) = maxval(abs(real(stress(5:6))))
  end subroutine read_layer

  !> Where the amplitudes are largest.
  subroutine layer_amplitude(self, at, motion, x)
    class(layer_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [Pa]
    complex(wp) :: stress(6)
    stress = stresses(at%m%s%bodies(self%marker%body), self, row_amplitudes(at, motion, self%marker%body, self%element))
    x(1) = stress(maxloc(abs(stress(1:4)), 1))
    if (self%core) x(2) = stress(4 + maxloc(abs(stress(5:6)), 1))
  end subroutine layer_amplitude

  !> Stresses of both faces at both ends, and shear stresses at a core's two points.
  pure function stresses(b, sensor, d) result(stress)
    type(body_model), intent(in) :: b
    type(layer_sensor_model), intent(in) :: sensor
    complex(wp), intent(in) :: d(:)           !! rows of the element, terms' differences included [m, rad]
    complex(wp) :: stress(6)                  !! [Pa]
    integer :: i, n
    stress = 0.0_wp
    n = 4
    associate (kind => b%layers%kinds(b%layers%kind(sensor%element)))
      associate (layer => b%layers%sections(kind%section)%layers(sensor%layer))
        do i = 1, size(d)
          if (kind%layer(i) /= sensor%layer) cycle
          stress(1:4) = stress(1:4) + layer%young*kind%strain(:, i)*d(i)
          if (.not. kind%shear(i)) cycle
          n = n + 1
          stress(n) = layer%shear*d(i)
        end do
      end associate
    end associate
  end function stresses

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
