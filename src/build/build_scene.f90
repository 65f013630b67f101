!> Turns the records of a deck into a scene of the model.
module build_scene
  use kinds, only: wp
  use errors, only: fault_list
  use acting_markers, only: acting_marker, list_acting
  use build_bodies, only: build_body
  use build_constraints, only: make_constraints, place_friction
  use build_controllers, only: make_controllers, place_controllers
  use build_loads, only: make_forces, place_stop_rows
  use build_factors, only: check_users, place_watches
  use build_quantities, only: check_coordinates, list_integrated
  use build_markers, only: marker_table, begin_markers, find_marker, scene_size, list_loaded
  use sorting, only: sort_by_number
  use deck_records, only: column_record, deck
  use internal_variables, only: internal_state
  use number_range, only: check_laws, check_distances
  use repeating_histories, only: check_repeating
  use scene_model, only: loss_cause, scene
  use springs, only: spring_model
  implicit none (type, external)
  private
  public :: build, number_internal

contains

  !> Builds the scene of a deck. If it adds faults, the scene must not be used.
  subroutine build(d, s, faults)
    type(deck), intent(in) :: d
    type(scene), intent(out) :: s
    type(fault_list), intent(inout) :: faults
    type(column_record), allocatable :: watched(:)   ! columns that the watches of factors watch
    s%title = d%scene%title
    s%materials = d%materials%label
    s%gravity = d%scene%gravity
    call check_laws(d, faults)
    call check_users(d, faults)
    if (faults%count > 0) return
    call make_constraints(d, s, faults)
    call make_forces(d, s, watched, faults)
    call make_controllers(d, s)
    call check_repeating(d, s, faults)
    if (faults%count == 0) call place_elements(d, s, watched, faults)
  end subroutine build

  !> Bodies, which ask the elements on which of their coordinates they act; the elements on their markers; everything numbered.
  subroutine place_elements(d, s, watched, faults)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s              !! its elements are made
    type(column_record), intent(in) :: watched(:)
    type(fault_list), intent(inout) :: faults
    type(acting_marker), allocatable :: acting(:, :)
    type(marker_table) :: markers
    integer, allocatable :: first(:), lumps(:)   ! lumps by body
    integer :: k, at(3)                          ! markers of a joint or drive
    logical :: moment_only
    acting = list_acting(d, s)
    call sort_by_number(d%lumps%marker%body, size(d%bodies), first, lumps)
    allocate (s%bodies(size(d%bodies)))
    do k = 1, size(d%bodies)
      call build_body(d, k, lumps(first(k):first(k + 1) - 1), acting, s%bodies(k), faults)
    end do
    if (faults%count == 0) call check_coordinates(d, s, faults)
    if (faults%count > 0) return
    s%size = scene_size(s, acting)
    markers = begin_markers(size(s%bodies))
    do k = 1, size(s%constraints)
      associate (c => s%constraints(k)%item)
        if (k <= s%permanent) then
          at = 0
          at(1) = find_marker(s, markers, acting(1, k)%marker)
          at(2) = find_marker(s, markers, acting(2, k)%marker)
          if (acting(3, k)%acts(3)) at(3) = find_marker(s, markers, acting(3, k)%marker)
          call c%attach(at(1), at(2), at(3))
        end if
        c%first = s%rows + 1
        c%size = s%size
        s%rows = s%rows + c%rows
        if (k <= s%permanent) s%permanent_rows = s%rows
      end associate
    end do
    call list_integrated(d, s)
    do k = 1, s%acting
      associate (f => s%forces(k)%item, pair => acting(:, s%permanent + k)%marker)
        moment_only = f%switches .and. .not. any(f%acts(1:2))
        f%ia = find_marker(s, markers, pair(1), moment_only)
        f%ib = find_marker(s, markers, pair(2), moment_only)
        if (allocated(f%measure)) then
          f%measure%ia = f%ia
          f%measure%ib = f%ib
        end if
        f%size = s%size
      end associate
    end do
    call place_friction(s)
    call place_stop_rows(s)
    call place_watches(d, s, watched, markers)
    call place_controllers(d, s, markers)
    s%markers = markers%items(1:markers%count)
    call check_distances(d, s, faults)
    call list_loaded(s)
    call number_unknowns(d, s)
  end subroutine place_elements

  !> Offsets of all unknowns, and the deck's own start.
  subroutine number_unknowns(d, s)
    type(deck), intent(in) :: d
    type(scene), intent(inout) :: s
    integer :: k, i
    allocate (s%qo(size(s%bodies)))
    do k = 1, size(s%bodies)
      s%qo(k) = s%nq
      s%nq = s%nq + 3 + s%bodies(k)%nf
    end do
    call number_internal(s)
    allocate (s%q0(s%nq), s%v0(s%nq), source=0.0_wp)
    allocate (s%stated(s%nq), source=.false.)
    do k = 1, size(s%bodies)
      i = s%qo(k)
      associate (r => d%bodies(k))
        s%q0(i + 1:i + 3) = [r%position, r%angle]
        s%v0(i + 1:i + 3) = [r%velocity, r%angular_velocity]
        s%stated(i + 1:i + 2) = r%velocity_stated
        s%stated(i + 3) = r%angular_velocity_stated
      end associate
    end do
    s%start = s%q0
  end subroutine number_unknowns

  !> Numbers the internal variables, from which the length of the state follows: those of second order of bodies, then of force
  !> elements; those of first order likewise; the states of controllers.
  pure subroutine number_internal(s)
    type(scene), intent(inout) :: s
    integer :: k, r, pass
    s%nzd = 0
    do pass = 1, 2                  ! the first one counts those of second order, which come before the others
      s%nz = s%nzd
      s%nzd = 0
      do k = 1, size(s%bodies)
        do r = 1, size(s%bodies(k)%segments)
          call number_terms(s, s%bodies(k)%segments(r))
        end do
      end do
      do k = 1, size(s%forces)
        call number_terms(s, s%forces(k)%item)
      end do
    end do
    do k = 1, size(s%controllers)
      s%controllers(k)%first = s%nz
      s%nz = s%nz + s%controllers(k)%states
    end do
    call number_losses(s)
    s%quadratures = 2 + s%elements + size(s%losses) + size(s%integrated)
    s%ny = 2*s%nq + s%nz + s%nzd + s%quadratures
  end subroutine number_internal

  !> Lists what dissipates by itself: terms of the materials that bodies have, of layers each by itself, and springs with damping.
  pure subroutine number_losses(s)
    type(scene), intent(inout) :: s
    type(loss_cause) :: cause
    integer :: b, r, k
    s%losses = [loss_cause ::]
    do b = 1, size(s%bodies)
      do r = 1, size(s%bodies(b)%segments)
        associate (segment => s%bodies(b)%segments(r))
          cause = loss_cause(material=segment%material, body=merge(b, 0, segment%layer > 0), layer=segment%layer)
          segment%losses = findloc(s%losses%material == cause%material .and. s%losses%body == cause%body .and. &
                                   s%losses%layer == cause%layer, .true., 1) - 1
          if (segment%losses >= 0) cycle
          segment%losses = size(s%losses)
          do k = 1, size(segment%law%alpha)
            cause%term = k
            s%losses = [s%losses, cause]
          end do
        end associate
      end do
    end do
    s%term_losses = size(s%losses)
    do k = 1, s%springs
      select type (f => s%forces(k)%item)
      class is (spring_model)
        if (f%damping > 0.0_wp .or. size(f%law%alpha) > 0) s%losses = [s%losses, loss_cause(spring=k)]
      end select
    end do
  end subroutine number_losses

  !> Gives the internal variables of one segment or force element the next numbers.
  pure subroutine number_terms(s, variables)
    type(scene), intent(inout) :: s
    class(internal_state), intent(inout) :: variables
    variables%offset = s%nzd
    variables%first_order = s%nz
    s%nzd = s%nzd + variables%law%second*variables%width
    s%nz = s%nz + variables%law%first*variables%width
  end subroutine number_terms
end module build_scene
