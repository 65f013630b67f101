!> Closes small gaps that the frames leave, by bending flexible bodies. A loop of flexible bodies may have more joints or drives
!> than its frames have motions: it closes only to the digits of the deck. Newton steps of least strain energy,
!>
!>   [K + s M  J^T] [x ]   [ 0 ]
!>   [J        0  ] [mu] = [-Phi]
!>
!> with K the stiffness of the bodies alone. Frames have no stiffness; s makes them definite and is too small to matter beside K.
module elastic_closing
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use dynamics, only: evaluate_start
  use frame_axes, only: to_global
  use joint_geometry, only: condense_geometry
  use linear_matrices, only: linear_mechanism
  use linearisation, only: linearise
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: close_elastically

  integer, parameter :: most_newton = 10
  real(wp), parameter :: negligible = 1.0e-12_wp     !! s over the least squared frequency of an elastic coordinate [-]

contains

  !> Moves q until all rows hold or no step helps; the caller checks which of the two.
  subroutine close_elastically(self, ev, gap, q)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: gap                      !! up to which a row holds [m]
    real(wp), intent(inout) :: q(:)                  !! (nq) [m, rad]
    type(mechanism_model) :: bodies                  ! without springs: their stiffness is no part of K
    type(linear_mechanism) :: lin
    type(stiffness_system) :: ds
    real(wp) :: rest(size(q)), no_force(self%s%rows)
    complex(wp), allocatable :: x(:)
    logical :: dependent(self%s%rows)
    integer :: pass
    bodies = self
    deallocate (bodies%s%forces)
    allocate (bodies%s%forces(0))
    bodies%s%acting = 0
    rest = 0.0_wp
    no_force = 0.0_wp
    do pass = 0, most_newton
      call evaluate_start(self, ev, q)
      if (maxval(abs(ev%rows%phi)) <= gap .or. pass == most_newton) return
      call condense_geometry(self, ev)
      call ev%schur%weak_rows(dependent)
      call linearise(bodies, ev, q, rest, rest, no_force, ev%action(:0), lin)
      call ds%build(bodies, lin, 0.0_wp, dependent)
      call ds%set_real(negligible*least_frequency(bodies, ds))
      call ds%factor()
      allocate (x(ds%n + ds%rows), source=(0.0_wp, 0.0_wp))
      x(ds%n + 1:) = -ev%rows%phi(ds%active)
      call ds%solve(x)
      if (.not. all(abs(x) < huge(1.0_wp))) return
      q = q + to_global(self, ev, real(x(1:ds%n), wp))
      deallocate (x)
      ds = stiffness_system()
    end do
  end subroutine close_elastically

  !> The least ratio of stiffness to mass on the diagonals of elastic coordinates [1/s2].
  pure real(wp) function least_frequency(m, ds) result(square)
    type(mechanism_model), intent(in) :: m
    type(stiffness_system), intent(in) :: ds
    integer :: b, k, e
    square = huge(1.0_wp)
    do b = 1, size(m%s%bodies)
      do k = m%s%qo(b) + 4, m%s%qo(b) + 3 + m%s%bodies(b)%nf
        e = ds%entry(k, k)
        if (ds%k(e) > 0.0_wp) square = min(square, ds%k(e)/ds%m(e))
      end do
    end do
  end function least_frequency
end module elastic_closing
