!> The matrices of the linearised mechanism on one sparse pattern: the union of their patterns with the joints' rows, entries
!> summed on it, and the stiffness of viscoelastic segments with the same terms summed to one group.
module linear_pattern
  use, intrinsic :: iso_fortran_env, only: int64
  use kinds, only: wp
  use linear_matrices, only: linear_mechanism
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
    real(wp), allocatable :: rounded_off(:)        !! what rounding took from it [N/m ...]
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

  !> Sums a matrix's entries on the pattern, and where asked what rounding takes away (Knuth's error-free sum).
  subroutine gather(self, a, values, rounded_off)
    class(symmetric_pattern), intent(in) :: self
    type(triplet_matrix), intent(in) :: a
    real(wp), intent(inout) :: values(:)    !! (entries) [any]
    real(wp), intent(inout), optional :: rounded_off(:) !! (entries) [as values]
    real(wp) :: x, s, t
    integer :: k, e
    do k = 1, a%count
      e = self%entry(a%rows(k), a%cols(k))
      x = a%values(k)
      s = values(e) + x
      t = s - values(e)
      if (present(rounded_off)) rounded_off(e) = rounded_off(e) + ((values(e) - (s - t)) + (x - t))
      values(e) = s
    end do
  end subroutine gather

  !> Segments with the same terms share a group.
  subroutine make_groups(self, lin, groups)
    class(symmetric_pattern), intent(in) :: self
    type(linear_mechanism), intent(in) :: lin
    type(ghm_group), allocatable, intent(out) :: groups(:)
    real(wp), allocatable :: values(:), rounded_off(:)
    integer, allocatable :: entry(:), first(:), next(:)
    logical, allocatable :: listed(:)
    integer :: g, j, i, n, e
    call like_segments(lin, first, next)
    allocate (groups(size(first)), listed(size(self%row)), entry(size(self%row)))
    allocate (values(size(self%row)), rounded_off(size(self%row)), source=0.0_wp)
    listed = .false.
    do g = 1, size(groups)
      groups(g)%law = lin%segments(first(g))%law
      n = 0
      j = first(g)
      do while (j > 0)
        associate (a => lin%segments(j)%stiffness)
          call gather(self, a, values, rounded_off)
          do i = 1, a%count
            e = self%entry(a%rows(i), a%cols(i))
            if (listed(e)) cycle
            listed(e) = .true.
            n = n + 1
            entry(n) = e
          end do
        end associate
        j = next(j)
      end do
      associate (e => entry(1:n))
        groups(g)%entry = e
        groups(g)%value = values(e)
        groups(g)%rounded_off = rounded_off(e)
        values(e) = 0.0_wp
        rounded_off(e) = 0.0_wp
        listed(e) = .false.
      end associate
    end do
  end subroutine make_groups

  !> Lists of segments with the same terms, found by a number that is made of their values.
  subroutine like_segments(lin, first, next)
    type(linear_mechanism), intent(in) :: lin
    integer, allocatable, intent(out) :: first(:)     !! (lists) first segment
    integer, allocatable, intent(out) :: next(:)      !! (segments) next one of its list, 0: none
    integer :: starts(size(lin%segments)), last(size(lin%segments)), bucket(size(lin%segments)), other(size(lin%segments))
    integer :: k, g, n, b
    bucket = 0
    next = [(0, k=1, size(lin%segments))]
    n = 0
    do k = 1, size(lin%segments)
      associate (law => lin%segments(k)%law)
        b = 1 + int(modulo(transfer(sum(law%alpha) + sum(law%viscosity) + sum(law%inertia), 1_int64), size(bucket, kind=int64)))
        g = bucket(b)
        do while (g > 0)
          if (lin%segments(starts(g))%law%equals(law)) exit
          g = other(g)
        end do
      end associate
      if (g > 0) then
        next(last(g)) = k
      else
        n = n + 1
        g = n
        starts(g) = k
        other(g) = bucket(b)
        bucket(b) = g
      end if
      last(g) = k
    end do
    first = starts(1:n)
  end subroutine like_segments
end module linear_pattern
