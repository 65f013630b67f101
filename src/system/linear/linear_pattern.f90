!> The matrices of the linearised mechanism on one sparse pattern: the union of their patterns with the joints' rows, entries
!> summed on it, and the stiffness of viscoelastic segments with the same terms summed to one group.
module linear_pattern
  use sorting, only: sort_by_number
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
    integer, allocatable :: number(:), entry(:), owner(:), first(:), sorted(:), filled(:)
    real(wp), allocatable :: value(:)       ! [N/m ...]
    integer :: j, i, n
    call number_laws(lin%segments, [(.true., j=1, size(lin%segments))], number)
    n = 0
    do j = 1, size(number)
      n = n + lin%segments(j)%stiffness%count
    end do
    allocate (entry(n), owner(n), value(n), groups(maxval([0, number])))
    filled = [(0, j=1, size(groups))]
    n = 0
    do j = 1, size(number)
      associate (a => lin%segments(j)%stiffness)
        value(n + 1:n + a%count) = a%values(1:a%count)
        owner(n + 1:n + a%count) = number(j)
        do i = 1, a%count
          entry(n + i) = self%entry(a%rows(i), a%cols(i))
        end do
        n = n + a%count
      end associate
      groups(number(j))%law = lin%segments(j)%law
      filled(number(j)) = filled(number(j)) + lin%segments(j)%stiffness%count
    end do
    do j = 1, size(groups)
      allocate (groups(j)%entry(filled(j)), groups(j)%value(filled(j)), groups(j)%rounded_off(filled(j)))
    end do
    filled = 0
    call sort_by_number(entry, size(self%row), first, sorted)
    do i = 1, n
      call put(entry(sorted(i)), value(sorted(i)), filled(owner(sorted(i))), groups(owner(sorted(i))))
    end do
    do j = 1, size(groups)
      groups(j)%entry = groups(j)%entry(1:filled(j))
      groups(j)%value = groups(j)%value(1:filled(j))
      groups(j)%rounded_off = groups(j)%rounded_off(1:filled(j))
    end do
  end subroutine make_groups

  !> Adds to the last entry of a group, or appends it.
  pure subroutine put(entry, value, filled, group)
    integer, intent(in) :: entry            !! of the pattern, not before the last one
    real(wp), intent(in) :: value           !! [N/m ...]
    integer, intent(inout) :: filled        !! entries of the group
    type(ghm_group), intent(inout) :: group
    logical :: new
    new = filled == 0
    if (.not. new) new = group%entry(filled) /= entry
    if (new) then
      filled = filled + 1
      group%entry(filled) = entry
      group%value(filled) = 0.0_wp
      group%rounded_off(filled) = 0.0_wp
    end if
    call add(value, group%value(filled), group%rounded_off(filled))
  end subroutine put
end module linear_pattern
