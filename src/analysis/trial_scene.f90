!> A scene beside the one that runs: built, set up and assembled for a question about it alone.
module trial_scene
  use kinds, only: wp
  use assembly, only: assemble
  use assembly_reports, only: assembly_report
  use build_scene, only: build
  use deck_records, only: deck
  use errors, only: failure, fault_list
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use mechanism_setup, only: set_up_mechanism
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: assemble_deck, assemble_scene, rigid_copy

contains

  !> A deck's rigid bodies with their joints and drives, and nothing else.
  pure function rigid_copy(d) result(rigid)
    type(deck), intent(in) :: d
    type(deck) :: rigid
    rigid = d
    rigid%bodies%flexible = .false.
    rigid%periodic%present = .false.
    rigid%joints%friction = 0.0_wp
    rigid%joints%friction_static = 0.0_wp
    rigid%joints%preload = 0.0_wp
    rigid%joints%preload_static = 0.0_wp
    deallocate (rigid%stops, rigid%forces, rigid%springs, rigid%controllers, rigid%sensors)
    allocate (rigid%stops(0), rigid%forces(0), rigid%springs(0), rigid%controllers(0), rigid%sensors(0))
  end function rigid_copy

  !> Builds the scene of a deck and assembles it; ok is false where either fails.
  subroutine assemble_deck(d, m, ev, q, report, ok, v)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(out) :: m
    type(evaluation), intent(out) :: ev
    real(wp), allocatable, intent(out) :: q(:)      !! (nq) assembled positions [m, rad]
    type(assembly_report), intent(out) :: report
    logical, intent(out) :: ok
    real(wp), allocatable, intent(out), optional :: v(:)   !! (nq) their rates [m/s, rad/s]
    type(scene) :: s
    type(fault_list) :: faults
    type(failure) :: fail
    call build(d, s, faults)
    ok = faults%count == 0
    if (.not. ok) return
    call assemble_scene(s, m, ev, q, report, fail, v)
    ok = .not. fail%happened()
  end subroutine assemble_deck

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
