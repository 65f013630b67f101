!> The matrices of the linearised mechanism on one sparse pattern: the union of their patterns with the joints' rows, entries
!> summed on it, and the stiffness of viscoelastic segments with the same terms summed to one group.
module linear_pattern
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
    integer :: k
    allocate (r(0), c(0))
    call append(lin%mass, r, c)
    call append(lin%damping, r, c)
    call append(lin%stiffness, r, c)
    do k = 1, size(lin%segments)
      call append(lin%segments(k)%stiffness, r, c)
    end do
    if (lin%jacobian%count > 0) then
      r = [r, number_of(lin%jacobian%rows(1:lin%jacobian%count))]
      c = [c, lin%jacobian%cols(1:lin%jacobian%count)]
      c = pack(c, r > 0)
      r = pack(r, r > 0)
    end if
    call self%make(n, r, c)
  end subroutine union_of_patterns

  !> Appends the places of a matrix's entries.
  subroutine append(a, r, c)
    type(triplet_matrix), intent(in) :: a
    integer, allocatable, intent(inout) :: r(:), c(:)
    if (a%count == 0) return
    r = [r, a%rows(1:a%count)]
    c = [c, a%cols(1:a%count)]
  end subroutine append

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

  !> Runs with the same terms share a group.
  subroutine make_groups(self, lin, kept)
    class(symmetric_pattern), intent(in) :: self
    type(linear_mechanism), intent(in) :: lin
    type(ghm_group), allocatable, intent(out) :: kept(:)
    type(ghm_group), allocatable :: groups(:)
    real(wp), allocatable :: values(:), rounded_off(:)
    logical, allocatable :: done(:)
    integer :: k, j, n, e
    allocate (groups(size(lin%segments)), done(size(lin%segments)))
    allocate (values(size(self%row)), rounded_off(size(self%row)), source=0.0_wp)
    done = .false.
    n = 0
    do k = 1, size(lin%segments)
      if (done(k)) cycle
      n = n + 1
      groups(n)%law = lin%segments(k)%law
      values = 0.0_wp
      rounded_off = 0.0_wp
      do j = k, size(lin%segments)
        if (done(j) .or. .not. lin%segments(j)%law%equals(lin%segments(k)%law)) cycle
        done(j) = .true.
        call gather(self, lin%segments(j)%stiffness, values, rounded_off)
      end do
      groups(n)%entry = pack([(e, e=1, size(values))], abs(values) > 0.0_wp)
      groups(n)%value = values(groups(n)%entry)
      groups(n)%rounded_off = rounded_off(groups(n)%entry)
    end do
    kept = groups(1:n)
  end subroutine make_groups
end module linear_pattern
