!> What all sensors have in common: the values of their columns at an evaluated state, and their complex amplitudes in the linear
!> response about it.
module sensor
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use marker, only: marker_model, marker_states
  implicit none (type, external)
  private
  public :: elastic_motion, marker_motion, scene_motion, vector_to_global

  !> A harmonic motion x exp(s t), with multipliers lambda exp(s t), about the present state.
  type, public :: harmonic_motion
    complex(wp) :: s = 0.0_wp                 !! [1/s]
    complex(wp), allocatable :: x(:)          !! (nq) unknowns of the linearisation [m, rad]
    complex(wp), allocatable :: lambda(:)     !! (rows) multipliers [N]
  end type harmonic_motion

  !> What a sensor reads: an evaluated state of a mechanism, and the states of all sensors' markers in it.
  type, public :: observation
    type(mechanism_model), pointer :: m => null()
    type(evaluation), pointer :: ev => null()     !! with the accelerations and multipliers of the state
    type(marker_model), pointer :: markers(:) => null()   !! of all sensors
    type(marker_states), pointer :: p => null()           !! their states
    real(wp), pointer, contiguous :: y(:) => null()   !! the state [m, rad] and per second
  end type observation

  !> A sensor.
  type, abstract, public :: sensor_model
    character(32) :: name = ''
    integer :: number = 0                     !! of it among all sensors: its marker's in the list of their states
    type(marker_model) :: marker              !! the marker where it measures; the ground's origin where it has none
  contains
    procedure(values_at), deferred :: read
    procedure(amplitudes_of), deferred :: respond
    procedure :: elastic_part
  end type sensor_model

  !> A sensor of what has no linear response, such as a product; the reader of decks refuses to ask for one.
  type, abstract, extends(sensor_model), public :: nonlinear_sensor
  contains
    procedure :: respond => no_amplitude
  end type nonlinear_sensor

  !> Makes an array of different kinds possible.
  type, public :: sensor_box
    class(sensor_model), allocatable :: item
  end type sensor_box

  abstract interface
    !> Values of the columns.
    subroutine values_at(self, at, x)
      import :: sensor_model, observation, wp
      class(sensor_model), intent(in) :: self
      type(observation), intent(in) :: at
      real(wp), intent(inout) :: x(:)         !! from its first column on [the columns' units]
    end subroutine values_at
    !> Amplitudes of the columns about that state, vectors in global axes.
    subroutine amplitudes_of(self, at, motion, x)
      import :: sensor_model, observation, harmonic_motion, wp
      class(sensor_model), intent(in) :: self
      type(observation), intent(in) :: at
      type(harmonic_motion), intent(in) :: motion
      complex(wp), intent(inout) :: x(:)      !! from its first column on [the columns' units]
    end subroutine amplitudes_of
  end interface

contains

  !> Amplitudes that nobody asks for.
  subroutine no_amplitude(self, at, motion, x)
    class(nonlinear_sensor), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [the columns' units]
    x = 0.0_wp
  end subroutine no_amplitude

  !> Elastic part (u, v, rotation) of a vector of coordinates or accelerations at the sensor's marker, body axes.
  pure function elastic_part(self, m, q) result(u)
    class(sensor_model), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)              !! (nq) [m, rad] or their derivatives
    real(wp) :: u(3)                          !! the same
    integer :: i
    u = 0.0_wp
    associate (b => self%marker%body)
      if (b == 0 .or. self%marker%node == 0) return
      i = m%s%qo(b) + 3
      u = m%s%bodies(b)%displacement(self%marker%node, q(i + 1:i + m%s%bodies(b)%nf))
    end associate
  end function elastic_part

  !> Elastic displacement (u, v, rotation) of a marker in body axes.
  pure function elastic_motion(m, marker, x) result(u)
    type(mechanism_model), intent(in) :: m
    type(marker_model), intent(in) :: marker
    complex(wp), intent(in) :: x(:)           !! (nq) coordinates or their derivatives [m, rad]
    complex(wp) :: u(3)                       !! [m, rad]
    integer :: i, n
    u = 0.0_wp
    if (marker%body == 0 .or. marker%node == 0) return
    i = m%s%qo(marker%body) + 3
    n = m%s%bodies(marker%body)%nf
    u = cmplx(m%s%bodies(marker%body)%displacement(marker%node, real(x(i + 1:i + n), wp)), &
              m%s%bodies(marker%body)%displacement(marker%node, aimag(x(i + 1:i + n))), wp)
  end function elastic_motion

  !> Displacement of a marker in body axes, and of its section's angle.
  pure function marker_motion(m, marker, rho, x) result(w)
    type(mechanism_model), intent(in) :: m
    type(marker_model), intent(in) :: marker
    real(wp), intent(in) :: rho(2)            !! its present position in body axes [m]
    complex(wp), intent(in) :: x(:)           !! (nq) [m, rad]
    complex(wp) :: w(3)                       !! [m, rad]
    integer :: i
    w = 0.0_wp
    if (marker%body == 0) return
    i = m%s%qo(marker%body)
    w = x(i + 1:i + 3) + elastic_motion(m, marker, x)
    w(1:2) = w(1:2) + x(i + 3)*[-rho(2), rho(1)]
  end function marker_motion

  !> Displacement of a marker of the scene in global axes, and of its section's angle.
  pure function scene_motion(m, ev, k, x) result(y)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                  !! marker
    complex(wp), intent(in) :: x(:)           !! (nq) [m, rad]
    complex(wp) :: y(3)                       !! [m, rad]
    y = marker_motion(m, m%s%markers(k), ev%p%rho(:, k), x)
    y(1:2) = vector_to_global(ev, m%s%markers(k)%body, y(1:2))
  end function scene_motion

  !> A vector of a body's axes in global ones.
  pure function vector_to_global(ev, b, w) result(y)
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: b                  !! body, 0: the ground
    complex(wp), intent(in) :: w(2)           !! [any]
    complex(wp) :: y(2)                       !! [any]
    y = w
    if (b > 0) y = [ev%frame%cos(b)*w(1) - ev%frame%sin(b)*w(2), ev%frame%sin(b)*w(1) + ev%frame%cos(b)*w(2)]
  end function vector_to_global
end module sensor
