!> A scene beside the one that runs: built, set up and assembled for a question about it alone.
module trial_scene
  use kinds, only: wp
  use assembly, only: assemble
  use assembly_reports, only: assembly_report
  use errors, only: failure
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use mechanism_setup, only: set_up_mechanism
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: assemble_scene

contains

  !> Sets up the mechanism of a scene and assembles it.
  subroutine assemble_scene(s, m, ev, q, report, fail, v)
    type(scene), intent(in) :: s
    type(mechanism_model), intent(out) :: m
    type(evaluation), intent(out) :: ev
    real(wp), allocatable, intent(out) :: q(:)      !! (nq) assembled positions [m, rad]
    type(assembly_report), intent(out) :: report
    type(failure), intent(inout) :: fail
    real(wp), allocatable, intent(out), optional :: v(:)   !! (nq) their rates [m/s, rad/s]
    real(wp) :: rates(s%nq)                         ! [m/s, rad/s]
    call set_up_mechanism(m, ev, s)
    allocate (q(s%nq))
    call assemble(m, ev, q, rates, report, fail)
    if (present(v)) v = rates
  end subroutine assemble_scene
end module trial_scene
