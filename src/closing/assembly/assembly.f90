!> Closes the mechanism before any analysis (input/README.md, "Before the first analysis"): positions by Newton steps of least frame
!> motion, velocities with the least mass-weighted change, redundant constraints and degrees of freedom counted.
module assembly
  use kinds, only: wp
  use assembly_reports, only: assembly_report, add_warning
  use errors, only: failure, status_bad_input
  use evaluation_results, only: evaluation
  use locked_pins, only: warn_of_locked_pins
  use mechanism, only: mechanism_model
  use marker_motion, only: marker_kinematics
  use position_closing, only: close_positions, closed_gap, warn_of_drives, warn_of_motion
  use redundancy, only: count_freedoms
  use velocity_closing, only: close_velocities
  implicit none (type, external)
  private
  public :: assemble

contains

  !> Assembled positions and velocities; dissipative coordinates are relaxed by the caller.
  subroutine assemble(self, ev, q, v, report, fail)
    type(mechanism_model), intent(inout) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(out) :: q(:), v(:)             !! (nq) [m, rad], [m/s, rad/s]
    type(assembly_report), intent(out) :: report
    type(failure), intent(inout) :: fail
    real(wp) :: stated(size(self%s%constraints))    ! what drives prescribe, as the deck has it [m] or [rad]
    real(wp) :: gap                                 ! distance up to which markers coincide [m]
    integer :: k
    allocate (character(160) :: report%warnings(0))
    q = self%s%start
    v = self%s%v0
    call marker_kinematics(self, ev, q, v)
    do k = self%s%joints + 1, self%s%permanent
      associate (c => self%s%constraints(k)%item)
        stated(k) = c%position(ev%p)
        if (c%rate) c%measures(1)%item%datum = stated(k)
      end associate
    end do
    call close_positions(self, ev, q, v, report, fail)
    if (fail%happened()) return
    call warn_of_drives(self, stated, report)
    do k = self%s%joints + 1, self%s%permanent
      call self%s%constraints(k)%item%init_from_assembly(ev%p)
    end do
    ev%rows%begun = .false.
    call close_positions(self, ev, q, v, report, fail)    ! a relative drive may begin with another value than the assembled one
    if (fail%happened()) return
    call warn_of_motion(self, ev, q, report)
    do k = 1, self%s%joints
      call self%s%constraints(k)%item%init_from_assembly(ev%p)
    end do
    ev%rows%begun = .false.
    gap = closed_gap(self, ev)
    do k = 1, size(self%s%forces)
      call self%s%forces(k)%item%init_from_assembly(ev%p, gap)
    end do
    do k = 1, size(self%s%controllers)
      call self%s%controllers(k)%quantity%init_from_assembly(ev%p, gap)
    end do
    call require_directions(self, ev, gap, report, fail)
    if (fail%happened()) return
    call close_velocities(self, ev, q, v, report, fail)
    if (fail%happened()) return
    call count_freedoms(self, ev, q, v, report)
    call refuse_friction(self, report, fail)
    call warn_of_locked_pins(self, report)
  end subroutine assemble

  !> Refuses friction of joints whose reactions are not determined, and with them the motion.
  subroutine refuse_friction(self, report, fail)
    type(mechanism_model), intent(in) :: self
    type(assembly_report), intent(inout) :: report
    type(failure), intent(inout) :: fail
    integer :: k
    if (.not. self%redundant) return
    do k = 1, size(self%s%friction)
      associate (c => self%s%constraints(self%s%permanent + k)%item)
        if (c%parent == 0 .or. c%parent > self%s%permanent) cycle
        if (.not. report%dependent(c%parent)) cycle
        if (report%culprit == 0) report%culprit = c%parent
        call fail%raise(status_bad_input, 'joint "'//trim(c%name)//'": its reaction is not determined by rigid-body mechanics, '// &
                        'as joints hold the same motion twice, and so is its friction; expected a flexible body in the loop '// &
                        '(flexible=.true.), or a type=''slider'' in place of a ''prismatic'', or no friction there')
      end associate
    end do
  end subroutine refuse_friction

  !> Two markers whose line gives a joint or force its direction may coincide in the assembled scene. Refuses that, by name, or
  !> warns where it is allowed.
  subroutine require_directions(self, ev, gap, report, fail)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: gap              !! distance up to which markers coincide [m]
    type(assembly_report), intent(inout) :: report
    type(failure), intent(inout) :: fail
    character(:), allocatable :: text, told
    integer :: k
    do k = 1, self%s%joints
      associate (c => self%s%constraints(k)%item)
        text = c%fault(gap)
        if (len(text) > 0 .and. report%culprit == 0) report%culprit = k
        if (len(text) > 0) call fail%raise(status_bad_input, 'joint "'//trim(c%name)//'": '//text)
      end associate
    end do
    do k = 1, size(self%s%forces)
      associate (f => self%s%forces(k)%item)
        call f%check(ev%p, gap, text, told)
        if (len(text) > 0 .and. report%culprit == 0) report%culprit = self%s%permanent + k
        if (len(text) > 0) call fail%raise(status_bad_input, trim(f%group)//' "'//trim(f%name)//'": '//text)
        if (len(told) > 0) call add_warning(report, trim(f%group)//' "'//trim(f%name)//'" '//told)
      end associate
    end do
  end subroutine require_directions
end module assembly
