!> The matrices of the linearised mechanism (see `linearisation` for the equations and unknowns).
module linear_matrices
  use mechanism, only: mechanism_model
  use sorting, only: ascending
  use triplets, only: triplet_matrix
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: linear_mechanism, linear_segment, count_segments, number_laws

  !> Stiffness that one set of viscoelastic terms multiplies.
  type :: linear_segment
    integer :: body = 0                      !! body, or
    integer :: element = 0                   !! force element
    integer :: material = 0                  !! material (bodies)
    type(viscoelastic_terms) :: law
    type(triplet_matrix) :: stiffness        !! K_r at E_R
  end type linear_segment

  !> The linear system.
  type :: linear_mechanism
    integer :: n = 0                         !! unknowns (as many as coordinates, same offsets)
    integer :: rows = 0                      !! constraint rows
    type(triplet_matrix) :: mass, damping, stiffness   !! n x n
    type(triplet_matrix) :: loops            !! n x n: part of the damping by forces that follow rates of other bodies
    type(triplet_matrix) :: jacobian         !! rows x n
    type(linear_segment), allocatable :: segments(:)
    integer, allocatable :: before(:)        !! (bodies) segments of the bodies before
  end type linear_mechanism

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
end module linear_matrices
