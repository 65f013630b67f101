!> Columns of result files (README.md, "Run and check"): names, units, quantities; those of the motion of body frames and nodes.
module result_columns
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use text, only: to_text
  implicit none (type, external)
  private
  public :: labels_of, motion_columns, motion_row

  !> A column.
  type, public :: result_column
    character(68) :: name = ''        !! the sensor's, with a suffix where that has several columns
    character(12) :: unit = ''
    character(24) :: quantity = ''    !! that the sensor shows: columns of one quantity and unit have one scale
    logical :: number = .false.       !! of an element or a node, or a place in it: other ones in another mesh
  contains
    procedure :: label
    procedure :: of
    procedure :: part
  end type result_column

contains

  !> The column as files name it: name[unit].
  elemental character(80) function label(self)
    class(result_column), intent(in) :: self
    label = trim(self%name)//'['//trim(self%unit)//']'
  end function label

  !> The column of an owner, whose name comes first.
  elemental type(result_column) function of(self, owner)
    class(result_column), intent(in) :: self
    character(*), intent(in) :: owner
    of = result_column(owner//trim(self%name), self%unit, self%quantity, self%number)
  end function of

  !> The labels of columns that a function gives.
  pure function labels_of(columns) result(labels)
    type(result_column), intent(in) :: columns(:)
    character(80) :: labels(size(columns))
    labels = columns%label()
  end function labels_of

  !> A column made of this one, such as a real part.
  elemental type(result_column) function part(self, suffix, unit)
    class(result_column), intent(in) :: self
    character(*), intent(in) :: suffix
    character(*), intent(in), optional :: unit   !! where it has another one
    part = result_column(trim(self%name)//suffix, self%unit, self%quantity, self%number)
    if (present(unit)) part%unit = unit
  end function part

  !> The motion of all body frames and nodes, in the order of `motion_row`.
  function motion_columns(m) result(columns)
    type(mechanism_model), intent(in) :: m
    type(result_column), allocatable :: columns(:)   !! (3 a body and 2 a node)
    type(result_column) :: pair(2)
    character(:), allocatable :: body
    integer :: b, k, n
    allocate (columns(sum(3 + 2*m%s%bodies%nn)))
    pair = [result_column('.x', 'm', 'position'), result_column('.y', 'm', 'position')]
    n = 0
    do b = 1, size(m%s%bodies)
      body = trim(m%s%bodies(b)%name)
      columns(n + 1:n + 3) = [pair%of(body), result_column(body//'.angle', 'rad', 'angle')]
      n = n + 3
      do k = 1, m%s%bodies(b)%nn
        columns(n + 1:n + 2) = pair%of(body//'.'//to_text(k))
        n = n + 2
      end do
    end do
  end function motion_columns

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
end module result_columns
