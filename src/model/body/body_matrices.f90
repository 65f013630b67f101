!> Mass and stiffness of a flexible body in its nodal coordinates: triplets of lower triangles.
module body_matrices
  use kinds, only: wp
  use beam_element, only: element_mass, element_stiffness
  use body, only: body_model
  implicit none (type, external)
  private
  public :: mass_triplets, stiffness_triplets

  !> m_ff for many products: the lower triangle's entries.
  type, public :: mass_matrix
    integer, allocatable :: rows(:), cols(:)
    real(wp), allocatable :: values(:)                  !! [kg, kg m, kg m2]
  contains
    procedure :: assemble
    procedure :: times
  end type mass_matrix

contains

  !> Collects the entries.
  pure subroutine assemble(self, b)
    class(mass_matrix), intent(inout) :: self
    type(body_model), intent(in) :: b
    call mass_triplets(b, self%rows, self%cols, self%values)
  end subroutine assemble

  !> m_ff x.
  pure function times(self, x) result(y)
    class(mass_matrix), intent(in) :: self
    real(wp), intent(in) :: x(:)                        !! (nf) [m, rad, ...]
    real(wp) :: y(size(x))
    integer :: i, j, k
    y = 0.0_wp
    do k = 1, size(self%values)
      i = self%rows(k)
      j = self%cols(k)
      y(i) = y(i) + self%values(k)*x(j)
      if (i /= j) y(j) = y(j) + self%values(k)*x(i)
    end do
  end function times

  !> Lower triangle of m_ff as triplets (consistent mass and lumps with their rotary inertia).
  pure subroutine mass_triplets(b, rows, cols, values)
    type(body_model), intent(in) :: b
    integer, allocatable, intent(out) :: rows(:), cols(:)
    real(wp), allocatable, intent(out) :: values(:)     !! [kg, kg m, kg m2]
    real(wp) :: m(6, 6)
    integer :: e, i, n, k
    n = 21*b%ne + 3*size(b%lumps)
    allocate (rows(n), cols(n), values(n))
    n = 0
    do e = 1, b%ne
      m = element_mass(b%elements(e))
      call add_lower(b%edof(:, e), m, rows, cols, values, n)
    end do
    do k = 1, size(b%lumps)
      do i = 1, 3
        if (b%dof(i, b%lumps(k)%node) == 0) cycle
        n = n + 1
        rows(n) = b%dof(i, b%lumps(k)%node)
        cols(n) = rows(n)
        values(n) = merge(b%lumps(k)%inertia, b%lumps(k)%mass, i == 3)
      end do
    end do
    rows = rows(1:n)
    cols = cols(1:n)
    values = values(1:n)
  end subroutine mass_triplets

  !> Lower triangle of K_ff at E_R as triplets.
  pure subroutine stiffness_triplets(b, rows, cols, values)
    type(body_model), intent(in) :: b
    integer, allocatable, intent(out) :: rows(:), cols(:)
    real(wp), allocatable, intent(out) :: values(:)     !! [N/m, N, N m]
    real(wp) :: k(6, 6)
    integer :: e, n
    allocate (rows(21*b%ne), cols(21*b%ne), values(21*b%ne))
    n = 0
    do e = 1, b%ne
      k = element_stiffness(b%elements(e))
      call add_lower(b%edof(:, e), k, rows, cols, values, n)
    end do
    rows = rows(1:n)
    cols = cols(1:n)
    values = values(1:n)
  end subroutine stiffness_triplets

  !> Appends the entries of an element matrix's lower triangle whose coordinates remain.
  pure subroutine add_lower(dof, m, rows, cols, values, n)
    integer, intent(in) :: dof(6)                       !! coordinates of the element, 0: removed
    real(wp), intent(in) :: m(6, 6)                     !! symmetric, body axes [any]
    integer, intent(inout) :: rows(:), cols(:)
    real(wp), intent(inout) :: values(:)                !! [units of m]
    integer, intent(inout) :: n                         !! entries so far
    integer :: i, j
    do i = 1, 6
      do j = 1, i
        if (dof(i) == 0 .or. dof(j) == 0 .or. abs(m(i, j)) <= 0.0_wp) cycle
        n = n + 1
        rows(n) = dof(i)
        cols(n) = dof(j)
        values(n) = m(i, j)
      end do
    end do
  end subroutine add_lower
end module body_matrices
