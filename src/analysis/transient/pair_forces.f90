!> Contact forces of the joints on profiles over the rows of a run: the least, the largest, and when a joint first pulls. From then
!> on a follower that nothing holds would leave its profile.
module pair_forces
  use kinds, only: wp
  use archive, only: value_archive
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use summary_text, only: summary_record
  implicit none (type, external)
  private

  real(wp), parameter :: rounding = 1.0e-10_wp   !! of the largest multiplier, which no force is told by [-]

  !> Those of all pairs.
  type, public :: pair_watch
    integer, allocatable :: joint(:)               !! (pairs) numbers
    real(wp), allocatable :: force(:, :)           !! (3, pairs) least, largest, that of the last row [N]
    real(wp), allocatable :: time(:, :)            !! (3, pairs) of these; the last one when it first pulls, or huge [s]
    real(wp) :: last = 0.0_wp                      !! time of the last row; 0 before the first one [s]
    real(wp) :: scale = 0.0_wp                     !! largest multiplier of the scene [N]
  contains
    procedure :: begin
    procedure :: note
    procedure :: exchange
    procedure :: lines
  end type pair_watch

contains

  !> Before the first row.
  subroutine begin(self, joint)
    class(pair_watch), intent(inout) :: self
    integer, intent(in) :: joint(:)                !! those on profiles
    self%joint = joint
    if (allocated(self%force)) deallocate (self%force, self%time)
    allocate (self%force(3, size(joint)), self%time(3, size(joint)))
    self%force(1, :) = huge(1.0_wp)
    self%force(2:, :) = -huge(1.0_wp)
    self%time = huge(1.0_wp)
    self%last = 0.0_wp
    self%scale = 0.0_wp
  end subroutine begin

  !> A row. Between two rows a force is taken to be straight.
  pure subroutine note(self, m, ev, t)
    class(pair_watch), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: t                      !! [s]
    real(wp) :: force                              ! [N]
    integer :: k
    if (size(self%joint) > 0) self%scale = max(self%scale, maxval(abs(ev%lambda)))
    do k = 1, size(self%joint)
      force = -ev%lambda(m%s%constraints(self%joint(k))%item%first)
      associate (f => self%force(:, k), at => self%time(:, k))
        if (f(1) >= -rounding*self%scale) at(3) = huge(1.0_wp)   ! of the rows before
        if (force < f(1)) at(1) = t
        if (force > f(2)) at(2) = t
        f(1:2) = [min(f(1), force), max(f(2), force)]
        if (force < -rounding*self%scale .and. .not. at(3) < huge(1.0_wp)) then
          at(3) = self%last
          if (f(3) > 0.0_wp) at(3) = at(3) + (t - at(3))*f(3)/(f(3) - force)
        end if
        f(3) = force
      end associate
    end do
    self%last = t
  end subroutine note

  !> Saves or restores them.
  subroutine exchange(self, a)
    class(pair_watch), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%force)
    call a%exchange(self%time)
    call a%exchange(self%last, self%scale)
  end subroutine exchange

  !> A line of the summary for each.
  subroutine lines(self, m, text)
    class(pair_watch), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(summary_record), intent(inout) :: text
    integer :: k
    if (size(self%joint) == 0) return
    call text%open('pairs', '[')
    do k = 1, size(self%joint)
      associate (f => self%force(:, k), at => self%time(:, k))
        call text%open('', '{')
        call text%say('  contact of joint "{name='//trim(m%s%constraints(self%joint(k))%item%name)//'}": force from '// &
          '{least_force 4} N at t = {least_at 4} s to {largest_force 4} N at t = {largest_at 4} s', [f(1), at(1), f(2), at(2)])
        if (at(3) < huge(1.0_wp)) call text%say('; it first pulls at t = {pulls_at 4} s, where a follower that nothing holds '// &
                                                'would lift off', [at(3)])
        call text%line('')
        call text%close()
      end associate
    end do
    call text%close()
  end subroutine lines
end module pair_forces
