!> Columns of result files (README.md, "Reading and drawing results"): names `name[unit]` with a suffix, names and values of the
!> motion of body frames and nodes.
module column_names
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use text, only: to_text
  implicit none (type, external)
  private
  public :: suffixed, motion_names, motion_row

contains

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

  !> Frames (x, y, angle) and node positions (x, y) of every body [m, rad].
  pure function motion_row(m, q) result(row)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in), contiguous :: q(:)  !! (nq) [m, rad]
    real(wp) :: row(sum(3 + 2*m%s%bodies%nn)), u(3), x(2), c, s
    integer :: b, k, i, j
    j = 0
    do b = 1, size(m%s%bodies)
      i = m%s%qo(b)
      row(j + 1:j + 3) = q(i + 1:i + 3)
      j = j + 3
      c = cos(q(i + 3))
      s = sin(q(i + 3))
      associate (body => m%s%bodies(b))
        do k = 1, body%nn
          u = body%displacement(k, q(i + 4:i + 3 + body%nf))
          x = body%x(:, k) + u(1:2)
          row(j + 1:j + 2) = q(i + 1:i + 2) + [c*x(1) - s*x(2), s*x(1) + c*x(2)]
          j = j + 2
        end do
      end associate
    end do
  end function motion_row
end module column_names
