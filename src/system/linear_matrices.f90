!> The matrices of the linearised mechanism (see `linearisation` for the equations and unknowns).
module linear_matrices
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: linear_mechanism, linear_run, count_runs

  !> Stiffness that one set of GHM terms multiplies.
  type :: linear_run
    integer :: body = 0                      !! body, or
    integer :: spring = 0                    !! spring
    integer :: material = 0                  !! material (bodies)
    real(wp), allocatable :: alpha(:)        !! [-]
    real(wp), allocatable :: zeta(:)         !! [-]
    real(wp), allocatable :: omega(:)        !! [rad/s]
    type(triplet_matrix) :: stiffness        !! K_r at E_R
  end type linear_run

  !> The linear system.
  type :: linear_mechanism
    integer :: n = 0                         !! unknowns (as many as coordinates, same offsets)
    integer :: rows = 0                      !! constraint rows
    type(triplet_matrix) :: mass, damping, stiffness   !! n x n
    type(triplet_matrix) :: jacobian         !! rows x n
    type(linear_run), allocatable :: runs(:)
  end type linear_mechanism

contains

  !> Runs of bodies, then of springs.
  subroutine count_runs(m, lin)
    type(mechanism_model), intent(in) :: m
    type(linear_mechanism), intent(inout) :: lin
    integer :: b, r, k, n
    n = 0
    do b = 1, size(m%s%bodies)
      n = n + size(m%s%bodies(b)%runs)
    end do
    do k = 1, size(m%s%springs)
      if (size(m%s%springs(k)%alpha) > 0) n = n + 1
    end do
    allocate (lin%runs(n))
    n = 0
    do b = 1, size(m%s%bodies)
      do r = 1, size(m%s%bodies(b)%runs)
        n = n + 1
        associate (run => m%s%bodies(b)%runs(r))
          lin%runs(n)%body = b
          lin%runs(n)%material = run%material
          lin%runs(n)%alpha = run%alpha
          lin%runs(n)%zeta = run%zeta
          lin%runs(n)%omega = run%omega
        end associate
      end do
    end do
    do k = 1, size(m%s%springs)
      if (size(m%s%springs(k)%alpha) == 0) cycle
      n = n + 1
      lin%runs(n)%spring = k
      lin%runs(n)%alpha = m%s%springs(k)%alpha
      lin%runs(n)%zeta = m%s%springs(k)%zeta
      lin%runs(n)%omega = m%s%springs(k)%omega
    end do
  end subroutine count_runs
end module linear_matrices
