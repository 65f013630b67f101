!> Closes the mechanism's positions (input/README.md, "Before the first analysis"): Newton steps of least motion of the frames,
!> elastic coordinates fixed.
module position_closing
  use kinds, only: wp
  use assembly_reports, only: assembly_report, add_warning, open_joints
  use elastic_closing, only: close_elastically
  use errors, only: failure, status_bad_input
  use evaluation_settings, only: usual_options
  use joint_response, only: apply_multipliers
  use joint_system, only: constraint_values, condense_constraints
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use marker_motion, only: marker_kinematics
  use text, only: either, exact_text, short_text, to_text
  use projection, only: closed
  implicit none (type, external)
  private
  public :: close_positions, warn_of_drives, warn_of_motion, closed_gap, largest_motion

  integer, parameter :: most_newton = 200
  real(wp), parameter, public :: small = 1.0e-5_wp  !! |Phi| that bending may close: rounded decks; relative to the size [-]
  real(wp), parameter :: far = 0.05_wp              !! motion of a frame above which a warning is given, relative to the size [-]

contains

  !> Newton steps that move frames only, least sum of (dx2 + dy2)/S2 + dtheta2.
  subroutine close_positions(self, ev, q, v, report, fail)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(inout) :: q(:)   !! (nq) [m, rad]
    real(wp), intent(in) :: v(:)      !! (nq) [m/s, rad/s]
    type(assembly_report), intent(inout) :: report
    type(failure), intent(inout) :: fail
    real(wp), allocatable :: trial(:)
    real(wp) :: worst, before, length, turn   ! [m], [-]
    integer :: pass, b, tries
    if (self%s%rows > 0) then
      call frame_positions(self, ev, q, v, worst)
      do pass = 1, most_newton
        if (worst <= closed_gap(self, ev)) exit
        turn = min(1.0_wp, self%s%size/worst)  ! bodies that are far from each other come near before they turn
        do b = 1, size(self%s%bodies)
          ev%frame%l(:, b) = 0.0_wp
          ev%frame%dinv(:, b) = [self%s%size**2, self%s%size**2, turn**2]
        end do
        call condense_constraints(self, ev, .true.)
        call ev%schur%factor()
        ev%lambda = ev%rows%phi
        call ev%schur%solve(ev%lambda)
        call apply_multipliers(self, ev, ev%lambda, ev%a)
        trial = q
        before = worst
        length = min(1.0_wp, 0.5_wp/max(largest_motion(self, ev%a, merge(1.0_wp, 0.0_wp, turn >= 1.0_wp)), tiny(1.0_wp)))
        do tries = 1, 12
          q = trial + length*ev%a
          call frame_positions(self, ev, q, v, worst)
          if (worst <= (1 - 0.01_wp*length)*before) exit
          length = length/2
        end do
        if (tries > 12) exit
      end do
      report%newton = report%newton + pass - 1
      if (worst > closed_gap(self, ev) .and. worst <= small*self%s%size .and. any(self%flexible)) then
        call add_warning(report, 'flexible bodies are bent at the start: their frames alone leave joints or drives open by '// &
                         to_text(worst)//' m')
        call close_elastically(self, ev, closed_gap(self, ev), q)
        call frame_positions(self, ev, q, v, worst)
      end if
      report%open = worst > closed_gap(self, ev)
      if (report%open) then
        call fail%raise(status_bad_input, 'the mechanism cannot be assembled: '// &
                        open_joints(self, ev, ev%rows%phi, closed_gap(self, ev), '')// &
                        '; expected positions near which every joint and drive holds at t = 0')
        return
      end if
    end if
    call frame_positions(self, ev, q, v, worst)
  end subroutine close_positions

  !> |Phi| of a closed mechanism: 1e-12 of the size, but not below the rounding of positions far from the origin [m].
  pure function closed_gap(self, ev) result(gap)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp) :: gap
    gap = max(closed*self%s%size, 32*epsilon(1.0_wp)*maxval(abs(ev%p%r)))
  end function closed_gap

  !> Largest motion of a frame: relative to the size, or in radians.
  pure real(wp) function largest_motion(self, dq, part) result(motion)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(in) :: dq(:)   !! (nq) [m, rad]
    real(wp), intent(in) :: part    !! what a displacement counts beside a turn [-]
    integer :: b, i
    motion = 0.0_wp
    do b = 1, size(self%s%bodies)
      i = self%s%qo(b)
      motion = max(motion, part*norm2(dq(i + 1:i + 2))/self%s%size, abs(dq(i + 3)))
    end do
  end function largest_motion

  !> Markers and constraints at trial positions; the largest |Phi| [m].
  subroutine frame_positions(self, ev, q, v, worst)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: q(:), v(:)   !! (nq) [m, rad], [m/s, rad/s]
    real(wp), intent(out) :: worst       !! largest gap of a row [m]
    call marker_kinematics(self, ev, q, v)
    call constraint_values(self, ev, usual_options(self%s), 0.0_wp)
    worst = 0.0_wp
    if (self%s%rows > 0) worst = maxval(abs(ev%rows%phi))
    if (.not. worst < huge(1.0_wp)) worst = huge(1.0_wp)
  end subroutine frame_positions

  !> Warns where a frame moved by more than 5 % of the size.
  subroutine warn_of_motion(self, ev, q, report)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)   !! (nq) [m, rad]
    type(assembly_report), intent(inout) :: report
    real(wp) :: dx, da, least
    character(:), allocatable :: by
    integer :: b, i
    least = max(far*self%s%size, closed_gap(self, ev))
    do b = 1, size(self%s%bodies)
      i = self%s%qo(b)
      dx = norm2(q(i + 1:i + 2) - self%s%q0(i + 1:i + 2))
      da = abs(q(i + 3) - self%s%q0(i + 3))
      by = ''
      if (dx > least) by = by//' and '//short_text(dx, 2)//' m'
      if (da > far) by = by//' and '//short_text(da, 2)//' rad'
      if (len(by) > 0) call add_warning(report, 'assembly moved body "'//trim(self%s%bodies(b)%name)//'" by '//by(6:)// &
                                        ': are its deck position and angle right?')
    end do
  end subroutine warn_of_motion

  !> Warns where a drive moved its bodies by as much.
  subroutine warn_of_drives(self, stated, report)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(in) :: stated(:)     !! (constraints) the quantities as the deck has them [m] or [rad]
    type(assembly_report), intent(inout) :: report
    character(:), allocatable :: unit
    real(wp) :: start(0:2)                ! [m, rad], per s, per s2
    integer :: k
    do k = self%s%joints + 1, self%s%permanent
      associate (c => self%s%constraints(k)%item)
        if (c%measures(1)%item%pending) cycle
        call c%prescribed(0.0_wp, .false., start)
        if (abs(start(0) - stated(k)) <= far*merge(1.0_wp, self%s%size, c%angular)) cycle
        unit = either('rad', 'm', c%angular)
        call add_warning(report, 'drive "'//trim(c%name)//'" starts at '//exact_text(start(0))//' '//unit// &
                         ', the deck has its bodies at '//exact_text(stated(k))//' '//unit//': they were moved; expected the '// &
                         'same value in both, or relative=.true., which adds the history to the assembled value')
      end associate
    end do
  end subroutine warn_of_drives
end module position_closing
