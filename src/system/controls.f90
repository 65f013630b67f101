!> Controllers along a run: their outputs at a state of motion, their roots, what their events change. Their states are the last of
!> the internal variables.
module controls
  use kinds, only: wp
  use controller, only: free, at_upper, at_lower, unset, control_parts
  use evaluation_results, only: evaluation
  use evaluation_settings, only: evaluation_options
  use marker_motion, only: marker_displacement, marker_kinematics
  use measure, only: measured
  use mechanism, only: mechanism_model
  use root_watch, only: most_roots
  implicit none (type, external)
  private
  public :: put_out, switch_on_controls, start_controls, pass_control_events
  public :: control_inputs, solve_controls, control_states, control_slopes

contains

  !> Output of a controller, and rates of its states, from the motion of the markers; in a static analysis it is still switched off.
  pure subroutine put_out(m, ev, options, t, z, k)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: z(:)              !! (nz) [m, rad, any]
    integer, intent(in) :: k                  !! controller
    real(wp) :: w(m%s%controllers(k)%states + control_parts)   ! [any]
    integer :: law
    associate (c => m%s%controllers(k), x => ev%control(k))
      associate (first => c%first + 1, last => c%first + c%states)
        if (.not. options%controlled) then
          ev%zdd(first:last) = 0.0_wp
          x%output = 0.0_wp
          x%limited = 0
          return
        end if
        w = c%inputs(ev%p, t, options%left_limit, z(first:last))
        law = c%law_at(x%state, w)
        ev%zdd(first:last) = matmul(c%rates(:, :, law), w)
        x%output = dot_product(c%output(:, law), w)
        x%error = dot_product(c%error, w)
        x%parts = maxval(abs(c%demand*w))
        x%limited = c%limited(law, x%output)
      end associate
    end associate
  end subroutine put_out

  !> States at the moment when they are switched on.
  subroutine switch_on_controls(m, ev, q, v, z)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    real(wp), intent(inout) :: z(:)           !! (nz) [m, rad, any]
    integer :: k
    if (size(m%s%controllers) == 0) return
    call marker_kinematics(m, ev, q, v)
    do k = 1, size(m%s%controllers)
      associate (c => m%s%controllers(k))
        call c%start(ev%p, 0.0_wp, z(c%first + 1:c%first + c%states))
        ev%control(k)%state = unset
      end associate
    end do
  end subroutine switch_on_controls

  !> Starts the discrete states, which only events change from now on; takes the first sample.
  subroutine start_controls(m, ev, t, q, v, z, given)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                 !! that of a sample, where there are samples [s]
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    real(wp), intent(inout) :: z(:)           !! (nz) [m, rad, any]
    logical, intent(in) :: given              !! the states are; else as when they are switched on
    integer :: k
    if (.not. given) call switch_on_controls(m, ev, q, v, z)
    do k = 1, size(m%s%controllers)
      associate (c => m%s%controllers(k), x => ev%control(k))
        if (c%sample > 0.0_wp) then
          call c%take_sample(ev%p, nint(t/c%sample), z(c%first + 1:c%first + c%states))
          x%state = nint(t/c%sample) + 1
        else
          x%state = c%law_at(unset, c%inputs(ev%p, t, .false., z(c%first + 1:c%first + c%states)))
        end if
      end associate
    end do
  end subroutine start_controls

  !> Events: a sample is taken, a limit reached or left. A jump of the reference may lead beyond a limit at once.
  subroutine pass_control_events(m, ev, t, q, v, z, fallen)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    real(wp), intent(inout) :: z(:)           !! (nz) [m, rad, any]
    logical, intent(in) :: fallen(:)          !! (roots of controllers)
    real(wp), allocatable :: w(:)
    integer :: k
    if (size(m%s%controllers) == 0) return
    call marker_kinematics(m, ev, q, v)
    do k = 1, size(m%s%controllers)
      associate (c => m%s%controllers(k), x => ev%control(k), i => m%s%controllers(k)%first)
        if (.not. any(fallen(most_roots*(k - 1) + 1:most_roots*k))) cycle
        if (c%sample > 0.0_wp) then
          call c%take_sample(ev%p, x%state, z(i + 1:i + c%states))
          x%state = x%state + 1
          cycle
        end if
        w = c%inputs(ev%p, t, .false., z(i + 1:i + c%states))
        if (c%is_beyond(w)) then
          x%state = c%law_at(unset, w)
        else if (x%state == free) then
          x%state = merge(at_upper, at_lower, fallen(most_roots*(k - 1) + 1))
        else
          x%state = free
        end if
      end associate
    end do
  end subroutine pass_control_events

  !> Inputs of the states, f in x' = A x + f.
  subroutine control_inputs(m, ev, options, t, q, v, f)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    real(wp), intent(inout) :: f(:)           !! (nz) those of controllers are set [any/s]
    integer :: k
    if (size(m%s%controllers) == 0 .or. .not. options%controlled) return
    call marker_kinematics(m, ev, q, v)
    do k = 1, size(m%s%controllers)
      call one_input(m, ev, t, k, f)
    end do
  end subroutine control_inputs

  !> Of one controller, in the motion of the markers.
  pure subroutine one_input(m, ev, t, k, f)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: t                 !! [s]
    integer, intent(in) :: k                  !! controller
    real(wp), intent(inout) :: f(:)           !! (nz) [any/s]
    real(wp), dimension(m%s%controllers(k)%states) :: none
    real(wp) :: w(m%s%controllers(k)%states + control_parts)   ! [any]
    associate (c => m%s%controllers(k))
      none = 0.0_wp
      w = c%inputs(ev%p, t, .true., none)
      f(c%first + 1:c%first + c%states) = matmul(c%rates(:, :, c%law_at(ev%control(k)%state, w)), w)
    end associate
  end subroutine one_input

  !> Solves (c - A) y = x of all states.
  pure subroutine solve_controls(m, ev, c, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    complex(wp), intent(in) :: c              !! [1/s]
    complex(wp), intent(inout) :: x(:)        !! (states) [any], then [any s]
    integer :: k, first
    first = 1
    do k = 1, size(m%s%controllers)
      associate (control => m%s%controllers(k))
        call control%solve(control%law_in(ev%control(k)%state), c, x(first:first + control%states - 1))
        first = first + control%states
      end associate
    end do
  end subroutine solve_controls

  !> States at a trial state of an implicit step: those of the stage, or those that follow from the prediction.
  pure subroutine control_states(m, ev, c2, given, offset, z)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: c2                !! [1/s]
    logical, intent(in) :: given              !! by stages
    real(wp), intent(in) :: offset(:)         !! (nz) the states, or c2 z - z' of the prediction [any], [any/s]
    real(wp), intent(inout) :: z(:)           !! (nz) [any]
    complex(wp), allocatable :: x(:)
    integer :: k
    associate (first => m%s%controllers(1)%first + 1)
      z(first:) = offset(first:)
      if (given) return
      do k = 1, size(m%s%controllers)
        call one_input(m, ev, ev%t, k, z)
      end do
      x = z(first:) + offset(first:)
      call solve_controls(m, ev, cmplx(c2, 0.0_wp, wp), x)
      z(first:) = real(x, wp)
    end associate
  end subroutine control_states

  !> Derivatives of the states' rates at the last evaluation, A z' + f'.
  subroutine control_slopes(m, ev, t, zd, a)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in) :: zd(:)             !! (nz) [any/s]
    real(wp), intent(inout) :: a(:)           !! (nz) those of controllers are set [any/s2]
    type(measured) :: now
    real(wp) :: second, r(-1:2)
    integer :: k
    do k = 1, size(m%s%controllers)
      associate (c => m%s%controllers(k), quantity => m%s%controllers(k)%quantity)
        associate (first => c%first + 1, last => c%first + c%states)
          call quantity%measure(ev%p, now)
          second = dot_product(now%g, [acceleration(quantity%ia), acceleration(quantity%ib)]) + now%bias
          call c%reference%evaluate(t, ev%options%left_limit, r)
          a(first:last) = matmul(c%rates(:, :, c%law_in(ev%control(k)%state)), &
                                 [zd(first:last), merge(second, now%rate, quantity%rate), second, r(1), r(2), 0.0_wp])
        end associate
      end associate
    end do
  contains
    !> Of a marker: x, y, section angle.
    pure function acceleration(marker) result(y)
      integer, intent(in) :: marker
      real(wp) :: y(3)                        !! [m/s2], [rad/s2]
      y = marker_displacement(m, ev, marker, ev%a) + [ev%p%bias(:, marker), 0.0_wp]
    end function acceleration
  end subroutine control_slopes
end module controls
