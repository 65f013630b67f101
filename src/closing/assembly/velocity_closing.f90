!> Closes the mechanism's velocities (input/README.md, "Before the first analysis"): those that the deck states are kept, the others
!> follow by the least mass-weighted change; stated ones that contradict the joints are corrected least.
module velocity_closing
  use kinds, only: wp
  use assembly_reports, only: assembly_report, add_warning, open_joints, too_uneven, weakest_constraint, weakest_text
  use dynamics, only: evaluate_start
  use errors, only: failure, status_bad_input
  use joint_geometry, only: condense_geometry
  use joint_response, only: apply_multipliers
  use joint_system, only: condense_constraints, row_rates
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model, factor_frame
  use marker_motion, only: marker_kinematics
  use text, only: short_text
  implicit none (type, external)
  private
  public :: close_velocities

  real(wp), parameter :: stiff_weight = 1.0e3_wp    !! weight of stated velocities when they must be corrected [-]
  integer, parameter :: rounds = 8                  !! after each the corrections of stated ones are nearer to the least ones

contains

  !> Four attempts, until the rows hold:
  !> 1. stated velocities kept, the frames of the others follow;
  !> 2. stated velocities corrected as well, by the frames alone;
  !> 3. as 1, with the elastic rates;
  !> 4. as 2, with the elastic rates.
  !> A correction takes several rounds. In each the others start from the result of the last round. At the end stated velocities
  !> have changed only where the others cannot satisfy the rows. Then the others follow the corrected ones.
  subroutine close_velocities(self, ev, q, v, report, fail)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: q(:)            !! (nq) [m, rad]
    real(wp), intent(inout) :: v(:)         !! (nq) [m/s, rad/s]
    type(assembly_report), intent(inout) :: report
    type(failure), intent(inout) :: fail
    real(wp), allocatable :: start(:)
    real(wp) :: worst, goal
    integer :: attempt, pass, k
    logical :: uneven, beyond_digits, elastic_fixed
    start = v
    call evaluate_start(self, ev, q, v)
    if (self%s%rows == 0) return
    uneven = ev%schur%uneven_masses .or. ev%schur%ill_conditioned
    beyond_digits = uneven .and. ev%schur%beyond_digits()
    call row_rates(self, ev, ev%lambda)
    goal = 1.0e-11_wp*max(maxval(abs(ev%p%v)), self%s%size*maxval(abs(ev%p%rate)), maxval(abs(ev%rows%phi_t)))
    do attempt = 1, 4
      v = start
      elastic_fixed = attempt <= 2
      if (mod(attempt, 2) == 0) then
        do pass = 1, rounds
          where (self%s%stated) v = start
          call correct_velocities(self, ev, q, v, goal, worst, elastic_fixed, masked=.false.)
        end do
        if (worst <= goal) v = merge(v, start, self%s%stated)
      end if
      call correct_velocities(self, ev, q, v, goal, worst, elastic_fixed, masked=.true.)
      if (worst <= goal .or. beyond_digits) exit      ! rounding cannot be distinguished from a contradiction there
    end do
    call evaluate_start(self, ev, q, v)
    if (worst > goal .and. uneven) then
      report%culprit = weakest_constraint(self, ev)
      call fail%raise(status_bad_input, 'no velocities can be found at t = 0 that satisfy the joints and drives: '//too_uneven// &
                      weakest_text(self, ev))
      return
    else if (worst > goal) then
      call row_rates(self, ev, ev%lambda)
      do k = size(self%s%constraints), 1, -1
        associate (c => self%s%constraints(k)%item)
          if (maxval(abs(ev%lambda(c%first:c%first + c%rows - 1))) > goal) report%culprit = k
        end associate
      end do
      call fail%raise(status_bad_input, 'no velocities satisfy the joints and drives at t = 0: '// &
                      open_joints(self, ev, ev%lambda, goal, '/s')//'; the mechanism is locked or a drive starts from a '// &
                      'singular position; expected a drive that begins at rest, or another start')
      return
    end if
    call warn_of_velocities(self, ev, start, v, report)
  end subroutine close_velocities

  !> Velocity corrections until the rows hold.
  subroutine correct_velocities(self, ev, q, v, goal, worst, elastic_fixed, masked)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: q(:)            !! (nq) [m, rad]
    real(wp), intent(inout) :: v(:)         !! (nq) [m/s, rad/s]
    real(wp), intent(in) :: goal               !! [m/s]
    real(wp), intent(out) :: worst             !! largest |Phi'| left [m/s]
    logical, intent(in) :: elastic_fixed        !! by the frames alone
    logical, intent(in) :: masked              !! stated velocities are kept; else they are heavy
    logical :: good
    integer :: pass
    call evaluate_start(self, ev, q, v)   ! the metric is that of its mass matrix
    call weigh_frames(self, ev, elastic_fixed, masked)
    call condense_constraints(self, ev, elastic_fixed)
    call ev%schur%factor_strong(good)
    if (.not. good) then
      call condense_geometry(self, ev)
      call ev%schur%factor_uneven()
    end if
    do pass = 0, 6
      call marker_kinematics(self, ev, q, v)
      call row_rates(self, ev, ev%lambda)
      worst = maxval(abs(ev%lambda))
      if (worst <= 0.01_wp*goal .or. pass == 6) exit
      call ev%schur%solve(ev%lambda)
      call apply_multipliers(self, ev, ev%lambda, ev%a)
      v = v + ev%a
    end do
  end subroutine correct_velocities

  !> Frame metrics: the rigid mass, or the mass condensed by `evaluate`; stated components fixed (masked) or heavy.
  subroutine weigh_frames(self, ev, elastic_fixed, masked)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: elastic_fixed
    logical, intent(in) :: masked
    real(wp) :: m(3, 3), p(2), weight
    integer :: b, i, k
    do b = 1, size(self%s%bodies)
      i = self%s%qo(b)
      associate (body => self%s%bodies(b))
        if (elastic_fixed) then
          p = body%i1
          m = reshape([body%mass, 0.0_wp, -p(2), 0.0_wp, body%mass, p(1), -p(2), p(1), body%i11], [3, 3])
        else
          m = unfactored(ev%frame%l(:, b), ev%frame%dinv(:, b))
        end if
      end associate
      if (.not. masked) then
        do k = 1, 3
          weight = merge(sqrt(stiff_weight), 1.0_wp, self%s%stated(i + k))
          m(k, :) = m(k, :)*weight
          m(:, k) = m(:, k)*weight
          where (self%s%stated(i + 1:i + 3) .neqv. self%s%stated(i + k)) m(:, k) = 0.0_wp   ! others have no weight in the end
        end do
        call factor_masked(m, [.false., .false., .false.], ev%frame%l(:, b), ev%frame%dinv(:, b))
      else
        call factor_masked(m, self%s%stated(i + 1:i + 3), ev%frame%l(:, b), ev%frame%dinv(:, b))
      end if
    end do
  end subroutine weigh_frames

  !> L D L^T of a 3 x 3 matrix; masked components do not move (1/D = 0).
  pure subroutine factor_masked(m, fixed, frame_l, frame_dinv)
    real(wp), intent(in) :: m(3, 3)         !! [kg, kg m, kg m2]
    logical, intent(in) :: fixed(3)
    real(wp), intent(out) :: frame_l(3), frame_dinv(3) !! [m, -], [1/kg, 1/(kg m2)]
    real(wp) :: a(3, 3)
    integer :: k
    a = m
    do k = 1, 3
      if (.not. fixed(k)) cycle
      a(k, :) = 0.0_wp
      a(:, k) = 0.0_wp
      a(k, k) = 1.0_wp
    end do
    call factor_frame(a(1, 1), a(2, 1), a(2, 2), a(3, 1), a(3, 2), a(3, 3), frame_l, frame_dinv)
    where (fixed) frame_dinv = 0.0_wp
  end subroutine factor_masked

  !> The matrix of an L D L^T factor.
  pure function unfactored(frame_l, frame_dinv) result(m)
    real(wp), intent(in) :: frame_l(3), frame_dinv(3) !! [m, -], [1/kg, 1/(kg m2)]
    real(wp) :: m(3, 3), l(3, 3), ld(3, 3)
    integer :: k
    l = reshape([1.0_wp, frame_l(1), frame_l(2), 0.0_wp, 1.0_wp, frame_l(3), 0.0_wp, 0.0_wp, 1.0_wp], [3, 3])
    ld = 0.0_wp
    do k = 1, 3
      if (frame_dinv(k) > 0.0_wp) ld(:, k) = l(:, k)/frame_dinv(k)      ! 0: a pivot lost in rounding
    end do
    m = matmul(ld, transpose(l))
  end function unfactored

  !> Warns of stated velocities that had to change.
  subroutine warn_of_velocities(self, ev, start, v, report)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: start(:), v(:)  !! (nq) [m/s, rad/s]
    type(assembly_report), intent(inout) :: report
    real(wp) :: along, around, scale
    character(:), allocatable :: by
    integer :: b, i
    scale = max(maxval(abs(ev%p%v)), self%s%size*maxval(abs(ev%p%rate)), tiny(1.0_wp))
    do b = 1, size(self%s%bodies)
      i = self%s%qo(b)
      along = merge(norm2(v(i + 1:i + 2) - start(i + 1:i + 2)), 0.0_wp, self%s%stated(i + 1))
      around = merge(abs(v(i + 3) - start(i + 3)), 0.0_wp, self%s%stated(i + 3))
      by = ''
      if (along > 1.0e-6_wp*scale) by = by//' and '//short_text(along, 2)//' m/s'
      if (self%s%size*around > 1.0e-6_wp*scale) by = by//' and '//short_text(around, 2)//' rad/s'
      if (len(by) > 0) call add_warning(report, 'the stated velocity of body "'//trim(self%s%bodies(b)%name)// &
                                        '" contradicts the joints and was corrected by '//by(6:))
    end do
  end subroutine warn_of_velocities
end module velocity_closing
