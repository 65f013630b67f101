!> Which joints at rest take a share of the load that rigid bodies do not determine: friction, and rigid stops that are closed, may
!> hold the same motion, so that load can be moved from one to another (Wojtyra, Multibody System Dynamics 41, 2017, 161).
module friction_shares
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use friction_law, only: row_at_limit
  use joint_geometry, only: condense_geometry
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: dependent_rows, find_undetermined

  real(wp), parameter :: redundant = 1.0e-6_wp   !! relative pivot of the geometry below which a row depends on others [-]

contains

  !> The joints with friction at rest that could be left out without a further motion becoming possible.
  subroutine find_undetermined(m, ev, found)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev        !! of the present states
    logical, intent(out) :: found(:)             !! (joints with friction)
    logical, allocatable :: before(:)
    logical :: at_limit
    integer :: k, spare
    found = .false.
    if (size(found) == 0) return
    at_limit = any(abs(ev%switches%state(size(m%s%switching) + 1:)) == row_at_limit)
    if (.not. (at_limit .or. ev%schur%singular)) return
    before = ev%schur%off
    do k = 1, size(m%s%friction)
      associate (law => m%s%friction(k))
        if (abs(ev%switches%state(law%number)) == row_at_limit) ev%schur%off(law%row) = .false.
      end associate
    end do
    spare = dependent_rows(m, ev)
    do k = 1, size(found)
      associate (off => ev%schur%off(m%s%friction(k)%row))
        if (off) cycle
        off = .true.
        found(k) = dependent_rows(m, ev) < spare
        off = .false.
      end associate
    end do
    ev%schur%off = before
  end subroutine find_undetermined

  !> How many of the rows that hold depend on others.
  integer function dependent_rows(m, ev) result(n)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical :: weak(m%s%rows)
    call condense_geometry(m, ev)
    call ev%schur%weak_rows(weak, redundant)
    n = count(weak .and. .not. ev%schur%off)
  end function dependent_rows
end module friction_shares
