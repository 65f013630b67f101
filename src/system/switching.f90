!> Discrete states of force elements along a run: their roots, what their events change, and a list of the events since it was last
!> emptied (theory.md, section 11).
module switching
  use kinds, only: wp, ip
  use archive, only: value_archive
  use evaluation_results, only: evaluation, conditions_of, motion_of_row
  use marker_motion, only: marker_kinematics
  use mechanism, only: mechanism_model
  use root_watch, only: most_roots, watched_roots
  use measure, only: sunken
  use stops, only: stop_rebound
  implicit none (type, external)
  private
  public :: start_states, watch_roots, pass_events, element_name, is_rigid_stop, state_word, sunken_stop, too_soft

  !> An event of one element. The checkpoint keeps its words.
  type, public :: switch_event
    real(wp) :: t = 0.0_wp                    !! [s]
    integer :: element = 0                    !! its number among those that switch
    integer :: from = 0, to = 0               !! its states before and after
    real(wp) :: event_value = 0.0_wp          !! value stored at this event: of a stop the speed at touching [m/s] or [rad/s]
  end type switch_event

  !> The events since the list was last emptied.
  type, public :: event_list
    integer :: count = 0
    type(switch_event), allocatable :: items(:)
  contains
    procedure :: add
    procedure :: rebound_of
    procedure :: exchange
  end type event_list

contains

  !> States at the start, from positions alone.
  subroutine start_states(m, ev, q, v)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    integer :: i
    call marker_kinematics(m, ev, q, v)
    associate (s => m%s%switching, x => ev%switches)
      do i = 1, size(s)
        call m%s%forces(s(i))%item%switch(ev%p, conditions_of(m, ev, s(i)), 0, x%state(i), x%event_value(i))
      end do
    end associate
  end subroutine start_states

  !> Roots of some elements in their present states: of force elements and controllers in the motion of the markers, of rows
  !> after an evaluation.
  subroutine watch_roots(m, ev, first, last, t, left_limit, z, g, rate, zero)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: first, last        !! numbers among force elements, rows and controllers, in this order
    real(wp), intent(in) :: t                 !! [s]
    logical, intent(in) :: left_limit         !! a jump of a reference at t does not act yet
    real(wp), intent(in) :: z(:)              !! (nz) all internal variables [m, rad, any]
    real(wp), intent(inout) :: g(:), rate(:), zero(:) !! (roots of all) those of these elements are set [any], [any/s], [any]
    type(watched_roots) :: x
    integer :: i, k, n
    do i = first, last
      k = i - size(m%s%switching)
      if (k <= 0) then
        call m%s%forces(m%s%switching(i))%item%roots(ev%p, conditions_of(m, ev, m%s%switching(i)), x)
      else if (i <= m%s%elements) then
        call m%s%constraints(m%s%permanent + k)%item%roots(motion_of_row(m, ev, k), ev%lambda, x)
      else
        k = i - m%s%elements
        associate (c => m%s%controllers(k))
          call c%roots(t, ev%control(k)%state, c%inputs(ev%p, t, left_limit, z(c%first + 1:c%first + c%states)), left_limit, x)
        end associate
      end if
      n = most_roots*(i - 1)
      g(n + 1:n + most_roots) = x%g
      rate(n + 1:n + most_roots) = x%rate
      zero(n + 1:n + most_roots) = x%zero
    end do
  end subroutine watch_roots

  !> Switches the force elements whose roots have fallen, but for rigid stops, which `impacts` passes.
  subroutine pass_events(m, ev, t, q, v, fallen, list)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                 !! [s]
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) [m, rad] and per second
    logical, intent(in) :: fallen(:)          !! (roots)
    type(event_list), intent(inout) :: list
    integer :: i, k
    call marker_kinematics(m, ev, q, v)
    do i = 1, size(m%s%switching)
      k = findloc(fallen(most_roots*(i - 1) + 1:most_roots*i), .true., 1)
      if (k > 0 .and. .not. is_rigid_stop(m, i)) call switch_one(m, ev, t, i, k, list)
    end do
  end subroutine pass_events

  !> One element's event.
  subroutine switch_one(m, ev, t, i, which, list)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                 !! [s]
    integer, intent(in) :: i                  !! the element's number among those that switch
    integer, intent(in) :: which              !! its root
    type(event_list), intent(inout) :: list
    type(switch_event) :: event
    event = switch_event(t, i, ev%switches%state(i))
    associate (k => m%s%switching(i))
      call m%s%forces(k)%item%switch(ev%p, conditions_of(m, ev, k), which, event%to, event%event_value)
    end associate
    ev%switches%state(i) = event%to
    ev%switches%event_value(i) = event%event_value
    if (event%to /= event%from) call list%add(event)   ! a corner of a history is not reported
  end subroutine switch_one

  !> Whether an element is a rigid stop, which `impacts` passes.
  pure logical function is_rigid_stop(m, i) result(yes)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: i                  !! its number among those that switch
    yes = m%s%forces(m%s%switching(i))%item%row > 0
  end function is_rigid_stop

  !> The number of a stop that is pressed in as deep as its profile's radius of curvature; 0: none.
  pure integer function sunken_stop(m, ev) result(found)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer :: i
    found = 0
    do i = 1, m%s%stops
      if (ev%switches%state(i) == 0 .or. is_rigid_stop(m, i)) cycle
      if (m%s%forces(m%s%switching(i))%item%measure%sunk(ev%p)) found = i
    end do
  end function sunken_stop

  !> What is wrong with that stop.
  pure function too_soft(m, i) result(text)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: i                  !! its number
    character(:), allocatable :: text
    text = 'stop "'//element_name(m, i)//'" is softer than its own curvature: the follower is '//sunken// &
           '; expected a larger stiffness'
  end function too_soft

  !> The name of an element.
  pure function element_name(m, i) result(name)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: i                  !! its number among those that switch; controllers follow
    character(:), allocatable :: name
    associate (n => size(m%s%switching))
      if (i <= n) name = trim(m%s%forces(m%s%switching(i))%item%name)
      if (i > n .and. i <= m%s%elements) name = trim(m%s%constraints(m%s%permanent + i - n)%item%name)
      if (i > m%s%elements) name = trim(m%s%controllers(i - m%s%elements)%name)
    end associate
  end function element_name

  !> A state of an element in a word.
  pure function state_word(m, i, state) result(word)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: i                  !! its number among those that switch
    integer, intent(in) :: state
    character(:), allocatable :: word
    associate (n => size(m%s%switching))
      if (i <= n) word = m%s%forces(m%s%switching(i))%item%state_word(state)
      if (i > n) word = m%s%constraints(m%s%permanent + i - n)%item%state_word(state)
    end associate
  end function state_word

  !> Appends an event.
  pure subroutine add(self, event)
    class(event_list), intent(inout) :: self
    type(switch_event), intent(in) :: event
    if (.not. allocated(self%items)) allocate (self%items(0))
    if (self%count == size(self%items)) self%items = [self%items, self%items, event]
    self%count = self%count + 1
    self%items(self%count) = event
  end subroutine add

  !> The event of this time by which an element is left open after an impact; 0: none.
  pure integer function rebound_of(self, element, t) result(k)
    class(event_list), intent(in) :: self
    integer, intent(in) :: element            !! its number among those that switch
    real(wp), intent(in) :: t                 !! [s]
    do k = 1, self%count
      associate (x => self%items(k))
        if (x%element == element .and. abs(x%to) == stop_rebound .and. abs(x%t - t) <= 0.0_wp) return
      end associate
    end do
    k = 0
  end function rebound_of

  !> Saves or restores the list.
  subroutine exchange(self, a)
    class(event_list), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    integer(ip), allocatable :: words(:)
    if (.not. allocated(self%items)) allocate (self%items(0))
    words = transfer(self%items(:self%count), [0_ip])
    call a%exchange(words)
    if (a%saving) return
    self%items = transfer(words, self%items)
    self%count = size(self%items)
  end subroutine exchange
end module switching
