!> The one place that turns the deck's method into a stepper.
module choose_stepper
  use kinds, only: wp
  use adaptive_pair, only: adaptive_stepper
  use alpha_stepper, only: alpha_march
  use deck_records, only: transient_record
  use error_groups, only: group_unknowns
  use fixed_step, only: fixed_stepper
  use history, only: breakpoint, merged
  use radau_stepper, only: radau_march
  use scene_model, only: scene
  use step_counts, only: same_instant
  use tableaux, only: tableau, method_tableau
  use time_stepper, only: stepper
  implicit none (type, external)
  private
  public :: make_stepper, method_order

contains

  !> Order of a method, which decides where its steps have to end.
  pure integer function method_order(method) result(order)
    character(*), intent(in) :: method         !! the deck's word
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
      allocate (alpha_march :: march)
    else if (r%method == 'radau') then
      allocate (radau_march :: march)
    else if (r%adaptive) then
      allocate (adaptive_stepper :: march)
    else
      allocate (fixed_stepper :: march)
    end if
    associate (settings => march%settings)
      settings%adaptive = r%adaptive
      settings%order = method_order(r%method)
      settings%step = r%step
      settings%parts = r%parts
      settings%tolerance = r%tolerance
      settings%first_step = r%first_step
      if (r%max_step > 0.0_wp) settings%max_step = r%max_step
      call step_ends(r, s, settings%stops, settings%jumps)
    end associate
    call group_unknowns(s, march%norm)
    march%norm%fastest = fastest
    select type (march)
    type is (alpha_march)
      march%spectral_radius = r%spectral_radius
    class is (fixed_stepper)
      march%method = method_tableau(r%method)
    end select
  end subroutine make_stepper

  !> Times that end a step: the breakpoints of histories of loads, drives and controllers, and the end of the run; and whether
  !> accelerations jump there. Orders of breakpoints are those of accelerations. Fixed steps end at breakpoints that lower the
  !> method's order; steps by the error also at those that disturb its estimate. Where an error is asked for, fixed steps end at
  !> all, so that no load lies unseen between the stages of all passes.
  subroutine step_ends(r, s, ends, jumps)
    type(transient_record), intent(in) :: r
    type(scene), intent(in) :: s
    real(wp), allocatable, intent(out) :: ends(:)      !! [s]
    logical, allocatable, intent(out) :: jumps(:)
    type(breakpoint), allocatable :: list(:)
    integer :: k
    allocate (list(0))
    do k = 1, size(s%forces)
      list = merged(list, s%forces(k)%item%breakpoints(r%t_end))
    end do
    do k = 1, size(s%factors)
      list = merged(list, s%factors(k)%breakpoints(r%t_end))
    end do
    do k = 1, size(s%constraints)
      list = merged(list, s%constraints(k)%item%breakpoints(r%t_end))
    end do
    do k = 1, size(s%controllers)
      list = merged(list, s%controllers(k)%breakpoints(r%t_end))
    end do
    list = pack(list, .not. same_instant(list%time, r%t_end) .and. &
                (list%order <= method_order(r%method) - merge(0, 2, r%adaptive) .or. r%accuracy > 0.0_wp .or. r%every_break))
    ends = [list%time, r%t_end]
    jumps = [list%order == 0, .false.]
  end subroutine step_ends
end module choose_stepper
