!> The matrices of the linearised mechanism on one sparse pattern: the union of their patterns with the joints' rows, entries
!> summed on it, and the stiffness of viscoelastic segments with the same terms summed to one group.
module linear_pattern
  use kinds, only: wp
  use linear_matrices, only: linear_mechanism, number_laws
  use sparse_pattern, only: symmetric_pattern
  use triplets, only: triplet_matrix
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: ghm_group, union_of_patterns, gather, make_groups

  !> Entries that one law multiplies.
  type :: ghm_group
    type(viscoelastic_terms) :: law
    integer, allocatable :: entry(:)           !! entries of the pattern
    real(wp), allocatable :: value(:)          !! K_r there [N/m ...]
    real(wp), allocatable :: rounded_off(:)    !! its rounding error [N/m ...]
  end type ghm_group

contains

  !> The union of all patterns, joints included.
  subroutine union_of_patterns(self, n, lin, number_of)
    class(symmetric_pattern), intent(inout) :: self
    integer, intent(in) :: n                   !! unknowns and multipliers
    type(linear_mechanism), intent(in) :: lin
    integer, intent(in) :: number_of(:)        !! unknown of each multiplier, 0: left out
    integer, allocatable :: r(:), c(:)
    integer :: k, filled
    k = lin%mass%count + lin%damping%count + lin%stiffness%count + sum(lin%segments%stiffness%count) + lin%jacobian%count
    allocate (r(k), c(k))
    filled = 0
    call append(lin%mass)
    call append(lin%damping)
    call append(lin%stiffness)
    do k = 1, size(lin%segments)
      call append(lin%segments(k)%stiffness)
    end do
    call append(lin%jacobian)
    k = filled - lin%jacobian%count
    r(k + 1:) = number_of(r(k + 1:))
    call self%make(n, pack(r, r > 0), pack(c, r > 0))
  contains
    !> Appends the places of a matrix's entries.
    subroutine append(a)
      type(triplet_matrix), intent(in) :: a
      if (a%count == 0) return
      r(filled + 1:filled + a%count) = a%rows(1:a%count)
      c(filled + 1:filled + a%count) = a%cols(1:a%count)
      filled = filled + a%count
    end subroutine append
  end subroutine union_of_patterns

  !> Sums a matrix's entries on the pattern; where present, rounded_off gets the rounding errors of the sums.
  subroutine gather(self, a, values, rounded_off)
    class(symmetric_pattern), intent(in) :: self
    type(triplet_matrix), intent(in) :: a
    real(wp), intent(inout) :: values(:)    !! (entries) [any]
    real(wp), intent(inout), optional :: rounded_off(:) !! (entries) [as values]
    real(wp) :: rest                        ! [as values]
    integer :: k, e
    do k = 1, a%count
      e = self%entry(a%rows(k), a%cols(k))
      rest = 0.0_wp
      call add(a%values(k), values(e), rest)
      if (present(rounded_off)) rounded_off(e) = rounded_off(e) + rest
    end do
  end subroutine gather

  !> s + rest = s + rest + x, the rounding error of the sum kept in rest (Knuth's error-free sum).
  pure subroutine add(x, s, rest)
    real(wp), intent(in) :: x               !! [any]
    real(wp), intent(inout) :: s, rest      !! [as x]
    real(wp) :: before, t
    before = s
    s = before + x
    t = s - before
    rest = rest + ((before - (s - t)) + (x - t))
  end subroutine add

  !> Segments with the same terms share a group, its entries in the order of the pattern.
  subroutine make_groups(self, lin, groups)
    class(symmetric_pattern), intent(in) :: self
    type(linear_mechanism), intent(in) :: lin
    type(ghm_group), allocatable, intent(out) :: groups(:)
    integer, allocatable :: number(:)
    integer :: entry(size(self%row)), g, j, n
    real(wp), dimension(size(self%row)) :: value, rest   ! [N/m ...]
    call number_laws(lin%segments, spread(.true., 1, size(lin%segments)), number)
    allocate (groups(maxval([0, number])))
    do g = 1, size(groups)
      value = 0.0_wp
      rest = 0.0_wp
      do j = 1, size(number)
        if (number(j) == g) call gather(self, lin%segments(j)%stiffness, value, rest)
      end do
      groups(g)%law = lin%segments(findloc(number, g, 1))%law
      n = 0
      do j = 1, size(value)
        if (.not. abs(value(j)) + abs(rest(j)) > 0.0_wp) cycle
        n = n + 1
        entry(n) = j
      end do
      groups(g)%entry = entry(:n)
      groups(g)%value = value(entry(:n))
      groups(g)%rounded_off = rest(entry(:n))
    end do
  end subroutine make_groups
end module linear_pattern
