!> The linear system about a run's present state: evaluates the equations there, linearises, leaves dependent constraint rows
!> out.
module linear_state
  use kinds, only: wp
  use assembly_reports, only: too_uneven
  use dynamic_stiffness, only: stiffness_system
  use errors, only: failure, status_failed
  use evaluation_settings, only: evaluation_options
  use force_element, only: element_action
  use joint_correction, only: correct_accelerations, balanced
  use joint_geometry, only: condense_geometry
  use linear_matrices, only: linear_mechanism
  use linearisation, only: linearise
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use mechanism_ode, only: mechanism_system
  use scene_run, only: run_state
  implicit none (type, external)
  private
  public :: linear_system, linear_system_with, evaluate_state, refuse_uneven

  real(wp), parameter :: redundant = 1.0e-8_wp      !! pivot below which a row depends on others, as at assembly [-]

contains

  !> Evaluates the equations at a state, at rest in its dissipative coordinates or not, at t = 0. The reactions become stiffness, so
  !> that they are corrected to rounding even where uneven masses cost them only a few digits.
  subroutine evaluate_state(sys, options, y)
    type(mechanism_system), intent(inout) :: sys
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in), contiguous :: y(:)        !! (ny) layout in `scene_model` [m, rad], [m/s, rad/s], [J]
    real(wp), allocatable :: dy(:)
    allocate (dy(size(y)))
    call sys%rates(options, 0.0_wp, y, dy)
    if (sys%m%s%rows == 0 .or. sys%ev%schur%singular) return
    if (.not. balanced(sys%m, sys%ev)) call correct_accelerations(sys%m, sys%ev)
  end subroutine evaluate_state

  !> Refuses a state whose reactions, which become stiffness, are lost in rounding.
  subroutine refuse_uneven(run, analysis, fail)
    type(run_state), intent(in) :: run
    character(*), intent(in) :: analysis            !! name
    type(failure), intent(inout) :: fail
    if (run%sys%ev%schur%ill_conditioned) call fail%raise(status_failed, 'the '//analysis//' cannot be done: '//too_uneven// &
                                                         ', and the reactions cannot be computed')
  end subroutine refuse_uneven

  !> The dynamic stiffness about the present state.
  subroutine linear_system(run, ds)
    type(run_state), intent(inout) :: run
    type(stiffness_system), intent(out) :: ds
    type(linear_mechanism) :: lin
    call evaluate_state(run%sys, run%sys%options, run%y)
    associate (m => run%sys%m, ev => run%sys%ev)
      call linear_system_with(m, ev, run%y, ev%a, ev%lambda, ev%action, ds, lin)
    end associate
  end subroutine linear_system

  !> The linearisation about an evaluated state with given accelerations, multipliers and forces, and its dynamic stiffness.
  subroutine linear_system_with(m, ev, y, a, lambda, action, ds, lin)
    type(mechanism_model), intent(inout) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: y(:)        !! (ny) layout in `scene_model` [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in), contiguous :: a(:)        !! (nq) [m/s2, rad/s2]
    real(wp), intent(in), contiguous :: lambda(:)   !! (rows) [N]
    type(element_action), intent(in) :: action(:)   !! (force elements)
    type(stiffness_system), intent(out) :: ds
    type(linear_mechanism), intent(out) :: lin
    logical, allocatable :: dependent(:)
    call linearise(m, ev, y(1:m%s%nq), y(m%s%nq + 1:2*m%s%nq), a, lambda, action, lin)
    allocate (dependent(lin%rows))
    if (lin%rows > 0) then
      call condense_geometry(m, ev)
      call ev%schur%weak_rows(redundant, dependent)
    end if
    call ds%build(m, lin, dependent)
  end subroutine linear_system_with
end module linear_state
