!> Names of columns, `name[unit]`, in the header lines of result files (README.md, "Reading and drawing results").
module column_names
  use mechanism, only: mechanism_model
  use text, only: to_text
  implicit none (type, external)
  private
  public :: joined, suffixed, motion_names

contains

  !> All names, a blank before each.
  pure function joined(names) result(text)
    character(*), intent(in) :: names(:)
    character(:), allocatable :: text
    integer :: k, n
    allocate (character(sum(len_trim(names) + 1)) :: text)
    n = 0
    do k = 1, size(names)
      text(n + 1:n + 1 + len_trim(names(k))) = ' '//trim(names(k))
      n = n + 1 + len_trim(names(k))
    end do
  end function joined

  !> A name with a suffix before its unit.
  pure function suffixed(name, suffix) result(text)
    character(*), intent(in) :: name           !! name[unit]
    character(*), intent(in) :: suffix
    character(:), allocatable :: text
    integer :: bracket
    bracket = index(name, '[')
    text = name(:bracket - 1)//suffix//trim(name(bracket:))
  end function suffixed

  !> Names of the motion of all body frames and nodes, in the order of `motion_row`.
  function motion_names(m) result(names)
    type(mechanism_model), intent(in) :: m
    character(64), allocatable :: names(:)     !! (3 a body and 2 a node)
    character(:), allocatable :: name
    integer :: b, k, n
    allocate (names(sum(3 + 2*m%s%bodies%nn)))
    n = 0
    do b = 1, size(m%s%bodies)
      name = trim(m%s%bodies(b)%name)
      names(n + 1) = name//'.x[m]'
      names(n + 2) = name//'.y[m]'
      names(n + 3) = name//'.angle[rad]'
      n = n + 3
      do k = 1, m%s%bodies(b)%nn
        names(n + 1) = name//'.'//to_text(k)//'.x[m]'
        names(n + 2) = name//'.'//to_text(k)//'.y[m]'
        n = n + 2
      end do
    end do
  end function motion_names
end module column_names
