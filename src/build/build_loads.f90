!> Springs and loads of the model from their records.
module build_loads
  use build_history, only: make_history
  use build_places, only: place_table, find_place
  use deck_records, only: deck, force_record
  use load, only: load_model, axes_global, axes_body, axes_section, stage_all, stage_static, stage_transient, &
                  load_force, load_torque, load_about
  use scene_model, only: scene
  use viscoelastic_law, only: law_of
  implicit none (type, external)
  private
  public :: build_springs, build_forces

contains

  !> Springs.
  subroutine build_springs(d, s, places)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(place_table), intent(inout) :: places
    integer :: k
    allocate (s%springs(size(d%springs)))
    do k = 1, size(d%springs)
      associate (r => d%springs(k), sp => s%springs(k))
        sp%name = r%name
        sp%torsional = r%type == 'torsional'
        sp%stiffness = r%stiffness
        sp%damping = r%damping
        sp%free = r%free
        sp%pending = .not. r%has_free
        sp%law = law_of(r%ghm_alpha, r%ghm_zeta, r%ghm_omega, r%prony_alpha, r%prony_tau)
        sp%ia = find_place(s, places, r%a)
        sp%ib = find_place(s, places, r%b)
      end associate
    end do
  end subroutine build_springs

  !> Loads.
  subroutine build_forces(d, s, places)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    type(place_table), intent(inout) :: places
    integer :: k
    allocate (s%loads(size(d%forces)))
    do k = 1, size(d%forces)
      call fill_load(d, d%forces(k), s%loads(k))
      s%loads(k)%place = find_place(s, places, d%forces(k)%place)
    end do
  end subroutine build_forces

  !> One load without its place.
  subroutine fill_load(d, r, l)
    type(deck), intent(in) :: d
    type(force_record), intent(in) :: r
    type(load_model), intent(inout) :: l
    l%name = r%name
    l%f = [r%fx, r%fy]
    l%moment = r%moment
    l%centre = r%centre
    if (r%history > 0) call make_history(d, r%history, l%factor)
    select case (r%type)
    case ('force')
      l%kind = load_force
    case ('torque')
      l%kind = load_torque
    case default
      l%kind = load_about
    end select
    l%axes = axes_global
    if (r%axes == 'body') l%axes = axes_body
    if (r%axes == 'section') l%axes = axes_section
    l%stage = stage_all
    if (r%stage == 'static') l%stage = stage_static
    if (r%stage == 'transient') l%stage = stage_transient
  end subroutine fill_load
end module build_loads
