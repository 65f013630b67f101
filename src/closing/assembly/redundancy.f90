!> Rank of the constraints once the mechanism is assembled: redundant joints, degrees of freedom. A rank that drops only in
!> the position of the start does not make joints redundant.
module redundancy
  use kinds, only: wp
  use assembly_reports, only: assembly_report
  use dynamics, only: evaluate_start
  use joint_geometry, only: condense_geometry
  use joint_response, only: apply_multipliers
  use joint_system, only: row_rates
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: count_freedoms

  real(wp), parameter :: away(2) = [2.0e-3_wp, 8.0e-3_wp]   !! how far test positions lie from the start, of the size [-]

contains

  !> Rank of the constraints, the joints of redundant sets, degrees of freedom; row weights for very uneven masses.
  subroutine count_freedoms(self, ev, q, v, report)
    type(mechanism_model), intent(inout) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: q(:), v(:)      !! (nq) [m, rad], [m/s, rad/s]
    type(assembly_report), intent(inout) :: report
    logical, allocatable :: weak(:)
    real(wp), allocatable :: diagonal(:), x(:)
    integer :: i
    allocate (report%dependent(size(self%s%constraints)), source=.false.)
    report%freedoms = self%s%nq
    if (self%s%rows == 0) return
    allocate (weak(self%s%rows), x(self%s%rows))
    diagonal = [(ev%schur%diagonal(i)*ev%schur%scale(i)**2, i=1, self%s%rows)]
    if (maxval(diagonal) > 1.0e6_wp*minval(diagonal)) then
      where (diagonal > 0.0_wp) ev%schur%scale = 1.0_wp/sqrt(diagonal)
      call evaluate_start(self, ev, q, v)
    end if
    call condense_geometry(self, ev)
    call ev%schur%weak_rows(weak)
    report%rank = count(.not. weak)
    weak(self%s%permanent_rows + 1:) = .false.       ! rows that switch are still off
    report%freedoms = self%s%nq - report%rank
    if (.not. any(weak)) return
    self%redundant = stays_redundant(self, ev, q, v)
    if (self%redundant) ev%schur%shift = 1.0e-9_wp
    call evaluate_start(self, ev, q, v)
    x = merge([(1.5_wp + sin(1.69_wp*i), i=1, size(x))], 0.0_wp, weak)   ! a vector of the null space
    call ev%schur%remove_range(x)
    do i = 1, size(self%s%constraints)
      associate (c => self%s%constraints(i)%item)
        report%dependent(i) = any(abs(x(c%first:c%first + c%rows - 1)) > 1.0e-5_wp)
      end associate
    end do
  end subroutine count_freedoms

  !> Whether rows also depend on others a little away from the start. Otherwise the start is only a singular position. The test
  !> position lies along the velocities or, at rest, along a motion that the constraints allow. Near it rounding hides
  !> a row that depends on rows which depend on each other at the start; far from it the positions are not closed.
  logical function stays_redundant(self, ev, q, v) result(yes)
    type(mechanism_model), intent(inout) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: q(:), v(:)      !! (nq) [m, rad], [m/s, rad/s]
    real(wp), allocatable :: motion(:)
    logical, allocatable :: weak(:)
    real(wp) :: speed
    integer :: k
    allocate (weak(self%s%rows))
    motion = v
    if (.not. maxval(abs(v)) > 0.0_wp) then
      motion = [(sin(1.7_wp*k) + 0.2_wp, k=1, size(q))]
      call evaluate_start(self, ev, q, motion)
      call row_rates(self, ev, ev%lambda)
      call ev%schur%solve(ev%lambda)
      call apply_multipliers(self, ev, ev%lambda, ev%a)
      motion = motion + ev%a
    end if
    call evaluate_start(self, ev, q, motion)
    speed = maxval(abs(ev%p%v))
    yes = .true.
    if (.not. speed > 1.0e-9_wp*self%s%size) return
    do k = 1, size(away)
      call evaluate_start(self, ev, q + away(k)*self%s%size/speed*motion, v)
      call condense_geometry(self, ev)
      call ev%schur%weak_rows(weak)
      yes = any(weak)
      if (yes) return
    end do
  end function stays_redundant
end module redundancy
