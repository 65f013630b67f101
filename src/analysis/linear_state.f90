!> The linear system about a run's present state: evaluates the equations there, linearises, leaves dependent constraint rows
!> out.
module linear_state
  use kinds, only: wp
  use assembly_reports, only: too_uneven
  use dynamic_stiffness, only: stiffness_system
  use errors, only: failure, status_failed
  use joint_correction, only: correct_accelerations, balanced
  use joint_geometry, only: condense_geometry
  use linear_matrices, only: linear_mechanism
  use linearisation, only: linearise
  use scene_run, only: run_state
  implicit none (type, external)
  private
  public :: linear_system, evaluate_state, refuse_uneven

  real(wp), parameter :: redundant = 1.0e-8_wp      !! pivot below which a row depends on others, as at assembly [-]

contains

  !> Evaluates the equations at the present state, at rest in its dissipative coordinates or not, at t = 0. The reactions
  !> become stiffness, so that they are corrected to rounding even where uneven masses cost them only a few digits.
  subroutine evaluate_state(run)
    type(run_state), intent(inout) :: run
    real(wp), allocatable :: dy(:)
    allocate (dy(size(run%y)))
    call run%sys%derivative(0.0_wp, run%y, .false., dy)
    if (run%sys%m%s%rows == 0 .or. run%sys%m%schur%singular) return
    if (.not. balanced(run%sys%m)) call correct_accelerations(run%sys%m)
  end subroutine evaluate_state

  !> Refuses a state whose reactions, which become stiffness, are lost in rounding.
  subroutine refuse_uneven(run, analysis, fail)
    type(run_state), intent(in) :: run
    character(*), intent(in) :: analysis            !! name
    type(failure), intent(inout) :: fail
    if (run%sys%m%schur%ill_conditioned) call fail%raise(status_failed, 'the '//analysis//' cannot be done: '//too_uneven// &
                                                         ', and the reactions cannot be computed')
  end subroutine refuse_uneven

  !> The dynamic stiffness about the present state, and the linearisation where it is wanted.
  subroutine linear_system(run, ds, linear, evaluated)
    type(run_state), intent(inout) :: run
    type(stiffness_system), intent(out) :: ds
    type(linear_mechanism), intent(out), optional :: linear
    logical, intent(in), optional :: evaluated      !! the mechanism holds what is to be linearised: leave it as it is
    type(linear_mechanism) :: lin
    logical, allocatable :: dependent(:)
    logical :: anew
    integer :: nq
    nq = run%sys%m%s%nq
    anew = .true.
    if (present(evaluated)) anew = .not. evaluated
    if (anew) call evaluate_state(run)
    call linearise(run%sys%m, run%y(1:nq), run%y(nq + 1:2*nq), lin)
    allocate (dependent(lin%rows))
    if (lin%rows > 0) then
      call condense_geometry(run%sys%m)
      call run%sys%m%schur%weak_rows(redundant, dependent)
    end if
    call ds%build(run%sys%m, lin, dependent)
    if (present(linear)) linear = lin
  end subroutine linear_system
end module linear_state
