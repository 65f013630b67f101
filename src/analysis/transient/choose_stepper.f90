!> The one place that turns the deck's method into a stepper.
module choose_stepper
  use kinds, only: wp
  use adaptive_pair, only: adaptive_stepper
  use alpha_stepper, only: implicit_stepper
  use breakpoint_list, only: scene_breakpoints
  use deck_records, only: transient_record
  use error_groups, only: group_unknowns
  use fixed_step, only: fixed_stepper
  use history, only: breakpoint
  use radau_stepper, only: radau_march
  use scene_model, only: scene
  use tableaux, only: tableau, method_tableau
  use time_stepper, only: stepper
  implicit none (type, external)
  private
  public :: make_stepper, method_order

  !> Implicit steps satisfy the constraints but for rounding, 4e-14 of the scene's size where rows are nearly dependent: below
  !> this tolerance (1e-6 of the size times what a step may err by) the least scales grow, so that it is not taken for an error.
  real(wp), parameter :: finest = 1.0e-6_wp    !! [-]

contains

  !> Order of a method, for breakpoints that matter to it.
  pure function method_order(method) result(order)
    character(*), intent(in) :: method         !! the deck's word
    integer :: order
    type(tableau) :: explicit
    explicit = method_tableau(method)
    order = explicit%order
    if (method == 'radau') order = 5
    if (method == 'generalized_alpha') order = 2
  end function method_order

  !> A stepper for the deck's transient.
  subroutine make_stepper(r, s, fastest, march)
    type(transient_record), intent(in) :: r
    type(scene), intent(in) :: s
    real(wp), intent(in) :: fastest            !! largest frequency of the scene, where it is known [rad/s]
    class(stepper), allocatable, intent(out) :: march
    if (r%method == 'generalized_alpha') then
      call make_implicit(r, s, march)
    else if (r%method == 'radau') then
      call make_radau(r, s, march)
    else if (r%adaptive) then
      call make_adaptive(r, s, fastest, march)
    else
      call make_fixed(r, march)
    end if
  end subroutine make_stepper

  !> The implicit method, with fixed or controlled steps.
  subroutine make_implicit(r, s, march)
    type(transient_record), intent(in) :: r
    type(scene), intent(in) :: s
    class(stepper), allocatable, intent(out) :: march
    type(implicit_stepper), allocatable :: alpha
    allocate (alpha)
    alpha%spectral_radius = r%spectral_radius
    alpha%adaptive = r%adaptive
    alpha%step = r%step
    alpha%tolerance = r%tolerance
    alpha%first_step = r%first_step
    if (r%adaptive) then
      call group_unknowns(s, alpha%norm)
      alpha%norm%floor = alpha%norm%floor*max(1.0_wp, finest/r%tolerance)
    end if
    if (r%max_step > 0.0_wp) alpha%max_step = r%max_step
    call stop_times(r, s, alpha%stops, alpha%jumps)
    call move_alloc(alpha, march)
  end subroutine make_implicit

  !> The implicit method of order 5, with fixed or controlled steps.
  subroutine make_radau(r, s, march)
    type(transient_record), intent(in) :: r
    type(scene), intent(in) :: s
    class(stepper), allocatable, intent(out) :: march
    type(radau_march), allocatable :: radau
    allocate (radau)
    radau%adaptive = r%adaptive
    radau%step = r%step
    radau%tolerance = r%tolerance
    radau%first_step = r%first_step
    if (r%max_step > 0.0_wp) radau%max_step = r%max_step
    call group_unknowns(s, radau%norm)
    call stop_times(r, s, radau%stops, radau%jumps)
    call move_alloc(radau, march)
  end subroutine make_radau

  !> Explicit methods with a fixed step.
  subroutine make_fixed(r, march)
    type(transient_record), intent(in) :: r
    class(stepper), allocatable, intent(out) :: march
    type(fixed_stepper), allocatable :: fixed
    allocate (fixed)
    fixed%method = method_tableau(r%method)
    fixed%step = r%step
    call move_alloc(fixed, march)
  end subroutine make_fixed

  !> The adaptive method, which stops at every breakpoint.
  subroutine make_adaptive(r, s, fastest, march)
    type(transient_record), intent(in) :: r
    type(scene), intent(in) :: s
    real(wp), intent(in) :: fastest            !! [rad/s]
    class(stepper), allocatable, intent(out) :: march
    type(adaptive_stepper), allocatable :: adaptive
    allocate (adaptive)
    adaptive%method = method_tableau(r%method)
    adaptive%tolerance = r%tolerance
    adaptive%first_step = r%first_step
    if (r%max_step > 0.0_wp) adaptive%max_step = r%max_step
    call group_unknowns(s, adaptive%norm)
    adaptive%norm%fastest = fastest
    call stop_times(r, s, adaptive%stops, adaptive%jumps)
    call move_alloc(adaptive, march)
  end subroutine make_adaptive

  !> Times that end a step, the breakpoints of histories and the end of the run, and whether accelerations jump there.
  subroutine stop_times(r, s, stops, jumps)
    type(transient_record), intent(in) :: r
    type(scene), intent(in) :: s
    real(wp), allocatable, intent(out) :: stops(:)     !! [s]
    logical, allocatable, intent(out) :: jumps(:)
    type(breakpoint), allocatable :: breakpoints(:)
    integer :: k
    call scene_breakpoints(s, r%t_end, method_order(r%method), breakpoints)
    stops = [(breakpoints(k)%time, k=1, size(breakpoints)), r%t_end]
    jumps = [(breakpoints(k)%order == 0, k=1, size(breakpoints)), .false.]
  end subroutine stop_times
end module choose_stepper
