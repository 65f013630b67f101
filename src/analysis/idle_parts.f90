!> Parts of a deck that do nothing: forces and lumps that keep their default of 0. They run, but seldom as meant.
module idle_parts
  use kinds, only: wp
  use deck_records, only: deck, origin
  use posix, only: tell
  use text, only: to_text
  implicit none (type, external)
  private
  public :: warn_of_idle_parts

contains

  !> One line on standard error for each of them.
  subroutine warn_of_idle_parts(d)
    type(deck), intent(in) :: d
    integer :: k
    do k = 1, size(d%forces)
      if (d%forces(k)%type /= 'force' .or. maxval(abs([d%forces(k)%fx, d%forces(k)%fy])) > 0.0_wp) cycle
      call warn(d%forces(k)%at, 'force/'//trim(d%forces(k)%name), 'fx and fy are 0: it pushes nothing')
    end do
    do k = 1, size(d%lumps)
      if (max(d%lumps(k)%mass, d%lumps(k)%inertia) > 0.0_wp) cycle
      call warn(d%lumps(k)%at, 'lump', 'mass and inertia are 0: it adds nothing')
    end do
  end subroutine warn_of_idle_parts

  !> A warning with its place in the deck.
  subroutine warn(at, what, why)
    type(origin), intent(in) :: at
    character(*), intent(in) :: what, why
    call tell(at%file//':'//to_text(at%line)//': '//what//': warning: '//why)
  end subroutine warn
end module idle_parts
