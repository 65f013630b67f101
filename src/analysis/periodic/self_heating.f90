!> The temperatures at which losses and heat flow of a cycle agree (theory.md, section 15): of each body or spring with a
!> `thermal_resistance` T = T_ambient + R P(T), P its mean loss over a period. Secants in as many directions as there are such
!> parts, within bounds by the signs of T_ambient + R P - T; the machine is built anew at each temperature.
module self_heating
  use kinds, only: wp
  use cycle_search, only: cycle_state
  use deck_temperature, only: warm
  use difference_space, only: direction_space
  use errors, only: failure, fault_list, status_failed
  use scene_run, only: run_state, prepare_run
  use step_advice, only: stability_advice, advise
  use step_monitor, only: method_number
  use summary, only: temperature_lines
  use summary_text, only: summary_record
  use text, only: either, short_text, to_text
  use turn_log, only: turn_result
  implicit none (type, external)
  private

  integer, parameter :: most_rounds = 50
  integer, parameter :: most_lost = 10              !! steps to where no cycle is found, each half of the one before
  real(wp), parameter :: agreement = 1.0e3_wp        !! error of a temperature, of the warming, over the tolerance of the cycle [-]

  !> The parts that their losses warm.
  type, public :: heat_balance
    integer, allocatable :: part(:)                  !! number of a body, or of a spring behind all bodies
    character(6), allocatable :: kind(:)             !! 'body' or 'spring'
    character(32), allocatable :: name(:)
    real(wp), allocatable :: ambient(:)              !! [C]
    real(wp), allocatable :: resistance(:)           !! [K/W]
    real(wp), allocatable :: temperature(:)          !! [C]
    real(wp), allocatable :: loss(:)                 !! mean over a period [W]
    integer :: rounds = 0
  contains
    procedure :: begin
    procedure :: settle
    procedure :: lines
  end type heat_balance

contains

  !> The parts, at their ambient temperatures.
  subroutine begin(self, run)
    class(heat_balance), intent(inout) :: self
    type(run_state), intent(in) :: run
    integer :: k
    associate (b => run%d%bodies, s => run%d%springs)
      self%resistance = [b%thermal_resistance, s%thermal_resistance]
      self%part = pack([(k, k=1, size(self%resistance))], self%resistance > 0.0_wp)
      self%kind = [(merge('body  ', 'spring', k <= size(b)), k=1, size(self%resistance))]
      self%name = [b%name, s%name]
      self%ambient = [b%temperature, s%law%temperature]
    end associate
    self%kind = self%kind(self%part)
    self%name = self%name(self%part)
    self%ambient = self%ambient(self%part)
    self%resistance = self%resistance(self%part)
    self%temperature = self%ambient
  end subroutine begin

  !> Warms the parts until loss and heat flow agree; the cycle is then that of the warm machine. The first step is small: it tells
  !> the slope, by which the next ones come from below where the losses fall ever slower or rise ever faster.
  subroutine settle(self, run, cycle)
    class(heat_balance), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(cycle_state), intent(inout) :: cycle        !! found, at the ambient temperatures
    real(wp), parameter :: first_step = 0.01_wp      ! of the way to where the losses lead [-]
    type(direction_space) :: space
    type(turn_result) :: last
    real(wp), dimension(size(self%part)) :: low, high, goal, rest, next, before, goal_before   ! [C]
    real(wp), allocatable :: c(:)
    character(:), allocatable :: problem
    integer :: lost, turns                           ! cycles that were not found in this round, all turns before
    logical :: grows                                 ! the heat that is too much, with the temperature
    grows = .false.
    low = self%ambient
    high = huge(1.0_wp)
    call space%clear(size(low))
    do while (cycle%found)
      self%rounds = self%rounds + 1
      call find_losses(self, run, cycle)
      goal = self%ambient + self%resistance*self%loss
      associate (t => self%temperature, close => agreement*cycle%tolerance*maxval(abs(goal - self%ambient)))
        if (all(abs(goal - t) <= close)) return
        where (goal > t) low = t
        where (goal < t) high = t
        where (low >= high)                          ! a bound at other temperatures of the others
          low = self%ambient
          high = huge(1.0_wp)
        end where
        next = t + first_step*(goal - t)
        if (self%rounds > 1) then
          grows = all(goal > t) .and. norm2(goal - t) > norm2(goal_before - before)
          call add_secant(space, t - before, goal - goal_before)
          call space%fit(goal - t, [real(wp) ::], c, rest)
          next = t + rest + matmul(space%v(:, :space%count), c)
          if (dot_product(next - t, goal - t) <= 0.0_wp) next = goal
          where (next <= low .or. next >= high) next = merge(0.5_wp*(low + high), goal, high < huge(1.0_wp))
        end if
        before = t
        goal_before = goal
        last = cycle%turn
        lost = 0
        do
          turns = cycle%turns
          cycle%turn = last
          call warmed(run, self%part, next, cycle, problem)
          if (cycle%fail%happened()) return
          if (cycle%turns > turns .and. len(problem) > 0) lost = lost + 1
          if (len(problem) == 0 .or. lost > most_lost .or. maxval(abs(next - t)) <= close) exit
          next = 0.5_wp*(t + next)
        end do
        if (self%rounds == most_rounds) problem = to_text(most_rounds)//' rounds were made'
        if (len(problem) > 0) call cycle%fail%raise(status_failed, no_balance(self, goal, grows)//'; '//problem)
        cycle%found = len(problem) == 0
        t = next
      end associate
    end do
  end subroutine settle

  !> The machine at other temperatures, and its cycle; a problem is told.
  subroutine warmed(run, part, temperature, cycle, problem)
    type(run_state), intent(inout) :: run
    integer, intent(in) :: part(:)                   !! the heated ones
    real(wp), intent(in) :: temperature(:)           !! of these [C]
    type(cycle_state), intent(inout) :: cycle        !! that of other temperatures
    character(:), allocatable, intent(out) :: problem   !! empty: none
    type(stability_advice) :: advice
    type(fault_list) :: faults
    type(failure) :: fail
    integer :: k
    call warm(run%d, part, temperature, problem)
    if (len(problem) > 0) return
    call prepare_run(run, faults, fail)
    if (fail%happened()) problem = fail%message
    if (faults%count > 0) problem = faults%items(1)%message
    if (len(problem) > 0) return
    call advise(run%sys%m, run%sys%ev, run%y(1:run%sys%m%s%nq), advice)
    run%stable_steps = advice%lowest
    k = method_number(run%d%transient%method)
    if (k > 0) run%stable_step = advice%safe%step(k)
    cycle%most_turns = cycle%turns + run%d%periodic%most_turns
    call cycle%map%begin(run)
    call cycle%search_again(run)
    if (cycle%found) return
    problem = 'at '//short_text(maxval(temperature), 4)//' C no cycle is found'
    if (k > 0) problem = problem//', where steps of '//trim(run%d%transient%method)//' are stable up to '// &
                         short_text(run%stable_step, 3)//' s'
  end subroutine warmed

  !> What the last step tells of the losses, in the place of the oldest where there is one for each part.
  subroutine add_secant(space, step, answer)
    type(direction_space), intent(inout) :: space
    real(wp), intent(in) :: step(:), answer(:)       !! (parts) of the temperatures, of those that the losses lead to [K]
    associate (n => size(step))
      if (space%count == n) then
        space%v(:, :n - 1) = space%v(:, 2:n)
        space%w(:, :n - 1) = space%w(:, 2:n)
        space%count = n - 1
      end if
      call space%add(step, step/norm2(step), answer/norm2(step))
    end associate
  end subroutine add_secant

  !> Mean powers that the parts lose: the last integrals of the state are those of bodies.
  subroutine find_losses(self, run, cycle)
    class(heat_balance), intent(inout) :: self
    type(run_state), intent(in) :: run
    type(cycle_state), intent(in) :: cycle
    integer :: k, cause
    associate (s => run%sys%m%s, y => cycle%turn%end, bodies => size(run%sys%m%s%bodies))
      self%loss = y(s%ny - count(self%part <= bodies) + 1:)
      do k = size(self%loss) + 1, size(self%part)
        cause = findloc(s%losses%spring, self%part(k) - bodies, 1)
        if (cause == 0) self%loss = [self%loss, 0.0_wp]
        if (cause > 0) self%loss = [self%loss, y(s%ny - size(s%integrated) - size(s%losses) + cause)]
      end do
    end associate
    self%loss = self%loss/cycle%period
  end subroutine find_losses

  !> Why there is no balance: the part that is farthest from it.
  function no_balance(self, goal, grows) result(words)
    class(heat_balance), intent(in) :: self
    real(wp), intent(in) :: goal(:)                  !! temperatures to which the losses lead [C]
    logical, intent(in) :: grows                     !! the heat that is too much, with the temperature
    character(:), allocatable :: words
    integer :: k
    k = maxloc(abs(goal - self%temperature), 1)
    words = either('thermal runaway: ', 'no temperature was found at which losses and heat flow agree: ', grows)
    words = words//trim(self%kind(k))//' "'//trim(self%name(k))//'" at '//to_text(self%temperature(k))//' C loses '// &
            short_text(self%loss(k), 4)//' W, which leads to '//to_text(goal(k))//' C'
  end function no_balance

  !> What the summary says.
  subroutine lines(self, run, text)
    class(heat_balance), intent(in) :: self
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: kind
    integer :: k
    if (size(self%part) == 0) return
    call text%line('  losses and heat flow agree after {rounds #} rounds', [real(wp) :: self%rounds])
    call text%open('heated', '[')
    do k = 1, size(self%part)
      kind = trim(self%kind(k))
      call text%item('  '//kind//' "{'//kind//'='//trim(self%name(k))//'}" at {temperature} C: {loss 4} W over '// &
                     '{thermal_resistance} K/W from {ambient} C', &
                     [self%temperature(k), self%loss(k), self%resistance(k), self%ambient(k)])
    end do
    call text%close()
    call temperature_lines(run%d, text)
  end subroutine lines
end module self_heating
