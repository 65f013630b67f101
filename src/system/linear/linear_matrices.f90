!> The matrices of the linearised mechanism (see `linearisation` for the equations and unknowns). On one sparse pattern: the union
!> of their patterns with the joints' rows, entries summed on it, and the stiffness of viscoelastic segments with the same terms
!> summed to one group.
module linear_matrices
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use sorting, only: ascending
  use sparse_pattern, only: symmetric_pattern
  use triplets, only: triplet_matrix
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: linear_mechanism, linear_segment, linear_loop, count_segments, number_laws, ghm_group, loop_entries
  public :: union_of_patterns, gather, make_groups, make_loops

  !> Stiffness that one set of viscoelastic terms multiplies.
  type :: linear_segment
    integer :: body = 0                      !! body, or
    integer :: element = 0                   !! force element
    integer :: material = 0                  !! material (bodies)
    type(viscoelastic_terms) :: law
    type(triplet_matrix) :: stiffness        !! K_r at E_R
  end type linear_segment

  !> The loop of a controller, -b (place + s rate)^T: forces of a unit output, and what is sensed of a motion.
  type :: linear_loop
    type(triplet_matrix) :: place, rate      !! n x n
  end type linear_loop

  !> The linear system.
  type :: linear_mechanism
    integer :: n = 0                         !! unknowns (as many as coordinates, same offsets)
    integer :: rows = 0                      !! constraint rows
    type(triplet_matrix) :: mass, damping, stiffness   !! n x n
    type(triplet_matrix) :: loops            !! n x n: part of the damping by forces that follow rates of other bodies
    type(triplet_matrix) :: jacobian         !! rows x n
    type(linear_segment), allocatable :: segments(:)
    type(linear_loop), allocatable :: controlled(:)   !! (controllers) where loops are to be closed
    integer, allocatable :: before(:)        !! (bodies) segments of the bodies before
  end type linear_mechanism

  !> Entries that one law multiplies.
  type :: ghm_group
    type(viscoelastic_terms) :: law
    integer, allocatable :: entry(:)           !! entries of the pattern
    real(wp), allocatable :: value(:)          !! K_r there [N/m ...]
    real(wp), allocatable :: rounded_off(:)    !! its rounding error [N/m ...]
  end type ghm_group

  !> Entries that the transfer function of one controller multiplies.
  type :: loop_entries
    integer, allocatable :: entry(:)           !! entries of the pattern
    real(wp), allocatable :: place(:)          !! there [-], [m]
    real(wp), allocatable :: rate(:)           !! what s multiplies there [s], [m s]
  end type loop_entries

contains

  !> Makes the list of segments: those of bodies, then one for each force element with viscoelastic terms.
  subroutine count_segments(m, lin)
    type(mechanism_model), intent(in) :: m
    type(linear_mechanism), intent(inout) :: lin
    integer :: b, r, k, n
    n = 0
    do b = 1, size(m%s%bodies)
      n = n + size(m%s%bodies(b)%segments)
    end do
    do k = 1, size(m%s%forces)
      if (m%s%forces(k)%item%law%order() > 0) n = n + 1
    end do
    allocate (lin%segments(n), lin%before(size(m%s%bodies)))
    n = 0
    do b = 1, size(m%s%bodies)
      lin%before(b) = n
      do r = 1, size(m%s%bodies(b)%segments)
        n = n + 1
        associate (segment => m%s%bodies(b)%segments(r))
          lin%segments(n)%body = b
          lin%segments(n)%material = segment%material
          lin%segments(n)%law = segment%law
        end associate
      end do
    end do
    do k = 1, size(m%s%forces)
      if (m%s%forces(k)%item%law%order() == 0) cycle
      n = n + 1
      lin%segments(n)%element = k
      lin%segments(n)%law = m%s%forces(k)%item%law
    end do
  end subroutine count_segments

  !> Numbers the laws of some segments: segments with the same terms have the same number. They are found side by side in the order
  !> of a sum of their values.
  subroutine number_laws(segments, counts, number)
    type(linear_segment), intent(in) :: segments(:)
    logical, intent(in) :: counts(:)                  !! (segments)
    integer, allocatable, intent(out) :: number(:)    !! (segments) 0: does not count
    integer :: order(size(segments)), k, n, last
    logical :: new
    allocate (number(size(segments)), source=0)
    order = ascending([(sum(segments(k)%law%alpha) + sum(segments(k)%law%viscosity), k=1, size(segments))])
    n = 0
    last = 0
    do k = 1, size(order)
      if (.not. counts(order(k))) cycle
      new = last == 0
      if (.not. new) new = .not. segments(last)%law%equals(segments(order(k))%law)
      if (new) n = n + 1
      last = order(k)
      number(last) = n
    end do
  end subroutine number_laws

  !> The union of all patterns, joints included.
  subroutine union_of_patterns(self, n, lin, number_of)
    class(symmetric_pattern), intent(inout) :: self
    integer, intent(in) :: n                   !! unknowns and multipliers
    type(linear_mechanism), intent(in) :: lin
    integer, intent(in) :: number_of(:)        !! unknown of each multiplier, 0: left out
    integer, allocatable :: r(:), c(:)
    integer :: k, filled
    k = lin%mass%count + lin%damping%count + lin%stiffness%count + sum(lin%segments%stiffness%count) + lin%jacobian%count
    if (allocated(lin%controlled)) k = k + sum(lin%controlled%place%count) + sum(lin%controlled%rate%count)
    allocate (r(k), c(k))
    filled = 0
    call append(lin%mass)
    call append(lin%damping)
    call append(lin%stiffness)
    do k = 1, size(lin%segments)
      call append(lin%segments(k)%stiffness)
    end do
    if (allocated(lin%controlled)) then
      do k = 1, size(lin%controlled)
        call append(lin%controlled(k)%place)
        call append(lin%controlled(k)%rate)
      end do
    end if
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

  !> Loops of controllers on the pattern.
  subroutine make_loops(self, lin, loops)
    class(symmetric_pattern), intent(in) :: self
    type(linear_mechanism), intent(in) :: lin
    type(loop_entries), allocatable, intent(out) :: loops(:)
    real(wp), dimension(size(self%row)) :: place, rate   ! [-], [m]; [s], [m s]
    integer :: k, e
    if (.not. allocated(lin%controlled)) then
      allocate (loops(0))
      return
    end if
    allocate (loops(size(lin%controlled)))
    do k = 1, size(loops)
      place = 0.0_wp
      rate = 0.0_wp
      call gather(self, lin%controlled(k)%place, place)
      call gather(self, lin%controlled(k)%rate, rate)
      loops(k)%entry = pack([(e, e=1, size(place))], abs(place) + abs(rate) > 0.0_wp)
      loops(k)%place = place(loops(k)%entry)
      loops(k)%rate = rate(loops(k)%entry)
    end do
  end subroutine make_loops
end module linear_matrices
