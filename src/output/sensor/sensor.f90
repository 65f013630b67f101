!> What all sensors have in common: the values of their columns at an evaluated state, and their complex amplitudes in the linear
!> response about it.
module sensor
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use marker, only: marker_model, marker_states
  use measure, only: measure_model
  implicit none (type, external)
  private
  public :: elastic_motion, marker_motion, marker_moves, pair_motion, quantity_amplitude, vector_to_global

  !> A harmonic motion x exp(s t), with multipliers lambda exp(s t), about the present state.
  type, public :: harmonic_motion
    complex(wp) :: s = 0.0_wp                 !! [1/s]
    complex(wp), allocatable :: x(:)          !! (nq) unknowns of the linearisation [m, rad]
    complex(wp), allocatable :: lambda(:)     !! (rows) multipliers [N]
    integer :: marker = 0                     !! where a force drives it, 0: a drive does
    complex(wp) :: wrench(3) = 0.0_wp         !! that force, global axes [N, N, N m]
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
    type(marker_model) :: marker              !! where it measures; the ground's origin where it has none
    integer :: number = 0                     !! of that marker among those of all sensors
  contains
    procedure(values_at), deferred :: read
    procedure :: respond => no_amplitude
  end type sensor_model

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
  end interface

contains

  !> Amplitudes of the columns about that state, vectors in global axes. Of what has no linear response, such as a product, nobody
  !> asks for them: decks with a frequency response may not have it.
  subroutine no_amplitude(self, at, motion, x)
    class(sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! from its first column on [the columns' units]
    x = 0.0_wp
  end subroutine no_amplitude

  !> Elastic displacement (u, v, rotation) in body axes: of a node, or of a marker that coordinates move (`elastic_marker`).
  pure function elastic_motion(m, marker, x) result(u)
    type(mechanism_model), intent(in) :: m
    type(marker_model), intent(in) :: marker
    complex(wp), intent(in) :: x(:)           !! (nq) [m, rad]
    complex(wp) :: u(3)                       !! [m, rad]
    associate (b => m%s%bodies(marker%body), i => m%s%qo(marker%body) + 3, n => m%s%bodies(marker%body)%nf)
      if (marker%node > 0) then
        u = cmplx(b%displacement(marker%node, real(x(i + 1:i + n), wp)), b%displacement(marker%node, aimag(x(i + 1:i + n))), wp)
      else
        u = cmplx(marker%elastic(real(x(i + 1:i + n), wp)), marker%elastic(aimag(x(i + 1:i + n))), wp)
      end if
    end associate
  end function elastic_motion

  !> Displacement of a marker in body axes, and of its section's angle; the ground has none.
  pure function marker_motion(m, marker, rho, x) result(w)
    type(mechanism_model), intent(in) :: m
    type(marker_model), intent(in) :: marker
    real(wp), intent(in) :: rho(2)            !! its present position in body axes [m]
    complex(wp), intent(in) :: x(:)           !! (nq) [m, rad]
    complex(wp) :: w(3)                       !! [m, rad]
    w = 0.0_wp
    if (marker%body == 0) return
    associate (frame => x(m%s%qo(marker%body) + 1:m%s%qo(marker%body) + 3))
      w = frame + elastic_motion(m, marker, x)
      w(1:2) = w(1:2) + frame(3)*[-rho(2), rho(1)]
    end associate
  end function marker_motion

  !> Displacements of two markers of the scene in global axes, each with that of its section's angle.
  pure function pair_motion(at, a, b, x) result(y)
    type(observation), intent(in) :: at
    integer, intent(in) :: a, b               !! the markers
    complex(wp), intent(in) :: x(:)           !! (nq) [m, rad]
    complex(wp) :: y(6)                       !! [m, rad]
    integer :: k
    y(1:3) = marker_motion(at%m, at%m%s%markers(a), at%ev%p%rho(:, a), x)
    y(4:6) = marker_motion(at%m, at%m%s%markers(b), at%ev%p%rho(:, b), x)
    do k = 1, 4, 3
      y(k:k + 1) = vector_to_global(at%ev, at%m%s%markers(merge(a, b, k == 1))%body, y(k:k + 1))
    end do
  end function pair_motion

  !> Displacement w of a marker, and its rate: w', theta' H w and the turn of the elastic rate, global axes.
  pure subroutine marker_moves(at, motion, marker, p, k, place, rate)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    type(marker_model), intent(in) :: marker
    type(marker_states), intent(in) :: p      !! of it and others
    integer, intent(in) :: k                  !! its number there
    complex(wp), intent(out) :: place(3)      !! [m, m, rad]
    complex(wp), intent(out) :: rate(3)       !! [m/s, m/s, rad/s]
    real(wp) :: u(2)                          ! elastic rate [m/s]
    integer :: i
    place = marker_motion(at%m, marker, p%rho(:, k), motion%x)
    place(1:2) = vector_to_global(at%ev, marker%body, place(1:2))
    rate = motion%s*place
    if (marker%body == 0) return
    i = at%m%s%qo(marker%body)
    associate (v => at%y(at%m%s%nq + i + 1:at%m%s%nq + i + 3), arm => at%ev%frame%to_global(marker%body, p%rho(:, k)))
      u = p%v(:, k) - v(1:2) - v(3)*[-arm(2), arm(1)]
      rate(1:2) = rate(1:2) + v(3)*[-place(2), place(1)] + motion%x(i + 3)*[-u(2), u(1)]
    end associate
  end subroutine marker_moves

  !> Amplitude of a quantity of motion, by its gradients along the motions of its two markers.
  complex(wp) function quantity_amplitude(at, motion, quantity, markers, p) result(x)   ! [m, rad] or [m/s, rad/s]
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    class(measure_model), intent(in) :: quantity
    type(marker_model), intent(in) :: markers(:)   !! its own and others
    type(marker_states), intent(in) :: p           !! their states
    complex(wp) :: place(6), rate(6)          ! of both markers [m, rad], [m/s, rad/s]
    real(wp) :: by_place(6), by_rate(6)       ! [-], [m], [1/s]
    call marker_moves(at, motion, markers(quantity%ia), p, quantity%ia, place(1:3), rate(1:3))
    call marker_moves(at, motion, markers(quantity%ib), p, quantity%ib, place(4:6), rate(4:6))
    call quantity%gradient(p, by_place, by_rate)
    x = sum(by_place*place) + sum(by_rate*rate)
  end function quantity_amplitude

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
