!> Closes the mechanism before any analysis (input/README.md, "Analyses"): positions by Newton steps of least frame motion,
!> velocities with the least mass-weighted change, redundant constraints and degrees of freedom counted.
module assembly
  use kinds, only: wp
  use assembly_reports, only: assembly_report
  use directions, only: require_directions
  use errors, only: failure
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use marker_motion, only: set_frames, marker_kinematics
  use position_closing, only: close_positions, closed_gap
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
    real(wp) :: gap                                 ! distance up to which markers coincide [m]
    integer :: k
    allocate (character(160) :: report%warnings(0))
    q = self%s%q0
    v = self%s%v0
    call set_frames(self, ev, q)
    call marker_kinematics(self, ev, q, v)
    do k = 1, size(self%s%constraints)
      call self%s%constraints(k)%item%init_from_deck(ev%p)
    end do
    call close_positions(self, ev, q, v, report, fail)
    if (fail%happened()) return
    do k = 1, size(self%s%constraints)
      call self%s%constraints(k)%item%init_from_assembly(ev%p)
    end do
    gap = closed_gap(self, ev)
    do k = 1, size(self%s%forces)
      call self%s%forces(k)%item%init_from_assembly(ev%p, gap)
    end do
    call require_directions(self, ev, gap, fail)
    if (fail%happened()) return
    call close_velocities(self, ev, q, v, report, fail)
    if (fail%happened()) return
    call count_freedoms(self, ev, q, v, report)
  end subroutine assemble
end module assembly
