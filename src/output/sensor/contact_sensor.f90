!> The contact of a follower and a profile: force, gap, place, direction of the normal, and Hertz' pressure.
module contact_sensor
  use kinds, only: wp, pi
  use contact_pair, only: pair_measure, pair_touch
  use force_sensors, only: stop_sensor_model
  use marker, only: turn
  use measure, only: measure_model
  use sensor, only: observation, sensor_model, harmonic_motion, pair_motion
  implicit none (type, external)
  private

  !> Of a joint, or of a stop.
  type, extends(sensor_model), public :: contact_sensor_model
    type(pair_measure) :: pair
    integer :: row = 0                        !! of a joint; 0: a stop
    type(stop_sensor_model) :: stop           !! shows the force of a stop
    real(wp) :: direction = 0.0_wp            !! from section a, from which the normal's angle counts [rad]
    real(wp) :: hardness = 0.0_wp             !! modulus over width; 0: no pressure is shown [Pa/m]
  contains
    procedure :: of
    procedure :: read => read_contact
    procedure :: respond => contact_amplitude
  end type contact_sensor_model

contains

  !> Takes the pair from its joint or stop.
  subroutine of(self, gap)
    class(contact_sensor_model), intent(inout) :: self
    class(measure_model), intent(in) :: gap
    select type (gap)
    class is (pair_measure)
      self%pair = gap
    end select
  end subroutine of

  !> As evaluated. The pressure is that of two cylinders, F E*/(pi width) times the sum of their curvatures under the root.
  subroutine read_contact(self, at, x)
    class(contact_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [N], [m], [m], [m], [rad], [Pa]
    type(pair_touch) :: now
    real(wp) :: pushing(3), bend              ! [N, m, -], [1/m]
    now = self%pair%touching(at%ev%p)
    if (self%row > 0) then
      pushing(1) = -at%ev%lambda(self%row)
    else
      call self%stop%read(at, pushing)
    end if
    x(1:4) = [pushing(1), now%x, now%place]
    x(5) = atan2(now%n(2), now%n(1)) - at%ev%p%angle(self%pair%ia) - self%direction
    x(5) = x(5) - 2*pi*anint(x(5)/(2*pi))
    if (.not. self%hardness > 0.0_wp) return
    bend = now%convexity
    if (self%pair%radius > 0.0_wp) bend = bend + 1/self%pair%radius
    x(6) = sqrt(max(pushing(1), 0.0_wp)*self%hardness*bend/pi)
  end subroutine read_contact

  !> The touching place is r_a - (x + radius) N - g3 HN: it moves with marker a, the gap and the normal, which H q turns.
  subroutine contact_amplitude(self, at, motion, x)
    class(contact_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! [N], [m], [m], [m], [rad], [Pa]
    type(pair_touch) :: now
    real(wp) :: h(6, 6)                       ! [1/m], [-], [m]
    complex(wp) :: u(6), dg(6), pushing(3)    ! [m, rad]
    now = self%pair%touching(at%ev%p)
    call self%pair%curvature(at%ev%p, h)
    u = pair_motion(at, self%pair%ia, self%pair%ib, motion%x)
    dg = matmul(h, u)
    if (self%row > 0) then
      pushing(1) = -motion%lambda(self%row)
    else
      call self%stop%respond(at, motion, pushing)
    end if
    x(1) = pushing(1)
    x(2) = sum(now%g*u)
    x(3:4) = u(1:2) - x(2)*now%n - (now%x + self%pair%radius)*dg(1:2) - dg(3)*turn(now%n) - now%g(3)*[-dg(2), dg(1)]
    x(5) = sum(turn(now%n)*dg(1:2)) - u(3)
  end subroutine contact_amplitude
end module contact_sensor
