!> The temperatures at which losses and heat flow of a cycle agree (theory.md, section 15): of each body or spring with a
!> `thermal_resistance` T = T_ambient + R P(T), P its mean loss over a period. The machine is built anew at each temperature.
module self_heating
  use kinds, only: wp
  use cycle_search, only: cycle_state
  use deck_temperature, only: warm
  use errors, only: failure, fault_list, status_failed
  use scene_run, only: run_state, prepare_run
  use step_advice, only: stability_advice, advise
  use summary, only: temperature_lines
  use summary_text, only: summary_record
  use text, only: either, short_text, to_text
  use turn_log, only: turn_result
  implicit none (type, external)
  private

  integer, parameter :: most_rounds = 50

  !> The parts that their losses warm.
  type, public :: heat_balance
    integer, allocatable :: part(:)                  !! number of a body, or of a spring behind all bodies
    character(6), allocatable :: kind(:)             !! 'body' or 'spring'
    character(32), allocatable :: name(:)
    real(wp), dimension(:), allocatable :: ambient, temperature   !! [C]
    real(wp), allocatable :: resistance(:)           !! [K/W]
    real(wp), allocatable :: loss(:)                 !! mean over a period [W]
    integer :: rounds = 0                            !! cycles that were sought
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
      self%resistance = self%resistance(self%part)
      self%ambient = [b%temperature, s%law%temperature]
      self%ambient = self%ambient(self%part)
      self%kind = merge('body  ', 'spring', self%part <= size(b))
      self%name = [b%name, s%name]
      self%name = self%name(self%part)
    end associate
    self%temperature = self%ambient
  end subroutine begin

  !> Warms the parts until loss and heat flow agree, by Broyden's method from steps to where the losses lead; the cycle is then that
  !> of the warm machine. A step to where a law has no value, or no cycle is found, is halved.
  subroutine settle(self, run, cycle)
    class(heat_balance), intent(inout) :: self
    type(run_state), intent(inout) :: run
    type(cycle_state), intent(inout) :: cycle        !! found, at the ambient temperatures
    real(wp), dimension(size(self%part)) :: step, rest, before, change   ! [K]
    real(wp) :: slope(size(self%part), size(self%part))   ! of the temperature over the rest, with the opposite sign [-]
    character(:), allocatable :: problem
    real(wp) :: allowed                              ! [K]
    integer :: k
    rest = 0.0_wp
    slope = 0.0_wp
    do k = 1, size(rest)
      slope(k, k) = 1.0_wp
    end do
    do
      before = rest
      call find_losses(self, run, cycle)
      rest = self%ambient + self%resistance*self%loss - self%temperature
      allowed = sqrt(cycle%tolerance)*maxval(self%resistance*abs(self%loss))
      if (self%rounds > 0 .and. all(max(abs(before), abs(rest)) <= allowed)) return   ! such a step has squared what was left
      if (self%rounds > 0) then
        change = matmul(slope, before - rest)
        associate (along => dot_product(step, change))
          if (abs(along) > 0.0_wp) slope = slope + matmul(reshape((step - change)/along, [size(rest), 1]), &
                                                          reshape(matmul(step, slope), [1, size(rest)]))
        end associate
      end if
      step = matmul(slope, rest)
      if (dot_product(step, rest) <= 0.0_wp) step = rest
      do
        call warmed(self, run, self%temperature + step, cycle, problem)
        if (cycle%fail%happened()) return
        if (len(problem) == 0 .or. maxval(abs(step)) <= allowed .or. self%rounds >= most_rounds) exit
        step = 0.5_wp*step
      end do
      if (len(problem) == 0 .and. self%rounds >= most_rounds) problem = to_text(most_rounds)//' rounds were made'
      if (len(problem) > 0) call cycle%fail%raise(status_failed, no_balance(self, rest, before)//'; '//problem)
      cycle%found = len(problem) == 0
      if (.not. cycle%found) return
      self%temperature = self%temperature + step
    end do
  end subroutine settle

  !> The machine at other temperatures, and its cycle from the present one; a problem is told.
  subroutine warmed(self, run, temperature, cycle, problem)
    class(heat_balance), intent(inout) :: self
    type(run_state), intent(inout) :: run
    real(wp), intent(in) :: temperature(:)           !! of the parts [C]
    type(cycle_state), intent(inout) :: cycle
    character(:), allocatable, intent(out) :: problem   !! empty: none
    type(stability_advice) :: advice
    type(turn_result) :: last
    type(fault_list) :: faults
    type(failure) :: fail
    call warm(run%d, self%part, temperature, problem)
    if (len(problem) > 0) return
    call prepare_run(run, faults, fail)
    if (fail%happened()) problem = fail%message
    if (faults%count > 0) problem = faults%items(1)%message
    if (len(problem) > 0) return
    call advise(run, advice)
    self%rounds = self%rounds + 1
    cycle%most_turns = cycle%turns + run%d%periodic%most_turns
    last = cycle%turn
    call cycle%map%begin(run)
    call cycle%find_cycle(run)
    if (cycle%found) return
    cycle%turn = last
    problem = 'at '//short_text(maxval(temperature), 4)//' C no cycle is found'
    if (run%stable_step < huge(1.0_wp)) problem = problem//', where steps of '//trim(run%d%transient%method)// &
                                                  ' are stable up to '//short_text(run%stable_step, 3)//' s'
  end subroutine warmed

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
    self%loss = self%loss/cycle%turn%period
  end subroutine find_losses

  !> Why there is no balance: the part that is farthest from it.
  function no_balance(self, rest, before) result(words)
    class(heat_balance), intent(in) :: self
    real(wp), intent(in) :: rest(:), before(:)       !! from the temperatures to where losses lead, and a round before [K]
    character(:), allocatable :: words
    integer :: k
    k = maxloc(abs(rest), 1)
    words = either('thermal runaway: ', 'no temperature was found at which losses and heat flow agree: ', &
                   all(rest > 0.0_wp) .and. norm2(rest) > norm2(before))
    words = words//trim(self%kind(k))//' "'//trim(self%name(k))//'" at '//to_text(self%temperature(k))//' C loses '// &
            short_text(self%loss(k), 4)//' W, which leads to '//to_text(self%temperature(k) + rest(k))//' C'
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
