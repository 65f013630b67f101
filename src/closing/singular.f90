!> Accelerations where a mechanism passes through a singular position: constraint rows become dependent for an instant (a
!> parallelogram in line). The minimum-norm solution then also follows the other branch of motion. The motion that arrives there
!> has a smooth acceleration. It is found as a mean of fourth order over states a little before and after, on the same branch. Rows
!> that are redundant everywhere are not of this kind: they keep the minimum-norm solution.
module singular
  use kinds, only: wp
  use dynamics, only: evaluate
  use evaluation_settings, only: evaluation_options, with_weak_pivots
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use projection, only: project
  implicit none (type, external)
  private
  public :: evaluate_branch, at_rest

  real(wp), parameter :: largest_turn = 5.0e-3_wp   !! largest turn of a body to the neighbouring states [rad]
  real(wp), parameter :: steady = 0.05_wp       !! largest change of velocities on the way, relative to the velocities [-]
  integer, parameter :: rounds = 3              !! improvements of the accelerations that lead to these states
  real(wp), parameter :: offsets(4) = [-1.0_wp, 1.0_wp, -2.0_wp, 2.0_wp]               !! of the states, in steps [-]
  real(wp), parameter :: weights(4) = [4.0_wp, 4.0_wp, -1.0_wp, -1.0_wp]/6.0_wp        !! fourth-order mean [-]

  !> Values of the branch of motion.
  type :: branch_values
    real(wp), allocatable :: a(:)               !! (nq) accelerations [m/s2, rad/s2]
    real(wp), allocatable :: lambda(:)          !! (rows) multipliers [N]
    real(wp) :: power = 0.0_wp                  !! put in [W]
  end type branch_values

contains

  !> Accelerations, multipliers and powers at a state, those of the branch of motion where the position is singular.
  subroutine evaluate_branch(m, ev, options, t, q, v, z, zd)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                   !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)      !! (nq) the state [m, rad], [m/s, rad/s]
    real(wp), intent(in), contiguous :: z(:), zd(:)     !! (nz) [m, rad], [m/s, rad/s]
    call evaluate(m, ev, options, t, q, v, z, zd)
    if (.not. ev%schur%singular .or. m%redundant .or. ev%switches%indeterminate) return
    call smooth_accelerations(m, ev, options, t, q, v, z, zd)
  end subroutine evaluate_branch

  !> Replaces accelerations, multipliers and input power of the last evaluation by those of the branch of motion. Cases:
  !> - drives at rest leave no freedom: no acceleration, though a singular position seems to allow one;
  !> - the mechanism moves and its neighbouring states are not singular: their mean;
  !> - else, where drives leave no freedom and come to rest here (a dead centre): the joints' equations solved as they are, as
  !>   long as they are not exactly singular;
  !> - else nothing changes.
  subroutine smooth_accelerations(m, ev, options, t, q, v, z, zd)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                   !! [s]
    real(wp), intent(in) :: q(:), v(:)          !! (nq) the state [m, rad], [m/s, rad/s]
    real(wp), intent(in) :: z(:), zd(:)         !! (nz) [m, rad], [m/s, rad/s]
    type(branch_values) :: branch
    real(wp), allocatable :: zr(:)              ! rates of all internal variables [m/s, rad/s]
    real(wp) :: s, rate
    logical :: ok
    integer :: round
    if (m%s%permanent_rows == m%s%nq .and. at_rest(ev, v)) then
      ev%a = 0.0_wp
      return
    end if
    rate = max(maxval(abs(ev%p%rate)), maxval(abs(ev%p%v))/m%s%size)
    ok = rate > 0.0_wp
    if (ok) then
      s = largest_turn/rate
      branch%a = ev%a
      zr = [zd(1:m%s%nzd), ev%zdd(m%s%nzd + 1:)]   ! an implicit method gives the rates of all
      ok = passes(m, ev, options, t, q, v, z, zd, rate, steady/s)
    end if
    do round = 1, rounds
      if (ok) ok = found_by_neighbours(m, ev, options, t, s, q, v, z, zr, branch)
    end do
    if (.not. ok .and. m%s%permanent_rows == m%s%nq) then
      call evaluate(m, ev, with_weak_pivots(options), t, q, v, z, zd)
      return
    end if
    call evaluate(m, ev, options, t, q, v, z, zd)
    if (.not. ok) return
    ev%a = branch%a
    ev%lambda = branch%lambda
    ev%input_power = branch%power
  end subroutine smooth_accelerations

  !> Whether nothing moves and no drive accelerates anything.
  pure logical function at_rest(ev, v) result(yes)
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)                !! (nq) [m/s, rad/s]
    yes = .not. (any(abs(v) > 0.0_wp) .or. any(abs(ev%rows%phi_t) > 0.0_wp) .or. any(abs(ev%rows%acceleration_bias) > 0.0_wp))
  end function at_rest

  !> Whether the motion passes through: its accelerations are small enough. Where drives leave no freedom it may come to rest there
  !> instead. Its accelerations then grow without bound, which the minimum-norm solution does not show.
  logical function passes(m, ev, options, t, q, v, z, zd, rate, most) result(yes)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                   !! [s]
    real(wp), intent(in) :: q(:), v(:), z(:), zd(:)   !! (nq), (nz) the state [m, rad], [m/s, rad/s]
    real(wp), intent(in) :: rate                !! at which the bodies turn [rad/s]
    real(wp), intent(in) :: most                !! largest growth of the velocities of a motion that passes [1/s]
    yes = steadily(m, ev, rate, most)
    if (.not. yes .or. m%s%permanent_rows < m%s%nq) return
    yes = maxval(abs(ev%rows%acceleration_bias)) < most*maxval(abs(ev%rows%phi_t))   ! the drives go on steadily
    if (.not. yes) return
    call evaluate(m, ev, with_weak_pivots(options), t, q, v, z, zd)
    yes = ev%schur%singular .or. steadily(m, ev, rate, most)
  end function passes

  !> Whether no frame's velocity grows faster than allowed, seen from the largest velocities.
  pure logical function steadily(m, ev, rate, most) result(yes)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: rate                !! at which the bodies turn [rad/s]
    real(wp), intent(in) :: most                !! [1/s]
    real(wp) :: speed
    integer :: b
    speed = maxval(abs(ev%p%v))                  ! [m/s]
    yes = .true.
    do b = 1, size(m%s%bodies)
      yes = yes .and. all(abs(ev%a(m%s%qo(b) + 1:m%s%qo(b) + 3)) <= most*[speed, speed, rate])
    end do
  end function steadily

  !> The mean over neighbouring states. They are reached with the present accelerations and projected onto the constraints. ok is
  !> false where one of them is singular.
  logical function found_by_neighbours(m, ev, options, t, s, q, v, z, zr, branch) result(ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t, s                !! time and step to the neighbours [s]
    real(wp), intent(in) :: q(:), v(:), z(:), zr(:)   !! (nq), (nz) the state, rates of z [m, rad], [m/s, rad/s]
    type(branch_values), intent(inout) :: branch      !! its accelerations are improved
    type(branch_values) :: mean
    real(wp), allocatable :: qn(:), vn(:), zn(:)
    real(wp) :: h
    integer :: k
    allocate (mean%a(size(ev%a)), mean%lambda(size(ev%lambda)), source=0.0_wp)
    do k = 1, size(offsets)
      h = offsets(k)*s
      qn = q + h*v + 0.5_wp*h**2*branch%a
      vn = v + h*branch%a
      zn = z + h*zr
      call evaluate(m, ev, options, t + h, qn, vn, zn, zr(1:m%s%nzd))
      ok = .not. ev%schur%singular .and. .not. ev%broken
      if (ok) call project(m, ev, options, t + h, qn, vn, zn, zr(1:m%s%nzd), ok)
      if (.not. ok) return
      call evaluate(m, ev, options, t + h, qn, vn, zn, zr(1:m%s%nzd))
      mean%a = mean%a + weights(k)*ev%a
      mean%lambda = mean%lambda + weights(k)*ev%lambda
      mean%power = mean%power + weights(k)*ev%input_power
    end do
    branch = mean
  end function found_by_neighbours
end module singular
