!> The internal variables of viscoelastic terms on one deformation, or on those of neighbouring elements: where they stand in the
!> state, their explicit rates, the power that they dissipate and the energy that they store (theory.md, section 5). Who owns the
!> deformation says what stiffness it has.
module internal_variables
  use kinds, only: wp
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private

  !> z(component, element, term): those of second order contiguous, and those of first order.
  type, abstract, public :: internal_state
    integer :: offset = 0                     !! of those of second order among the scene's, from 0
    integer :: first_order = 0                !! of those of first order
    integer :: width = 1                      !! coordinates of one term
    type(viscoelastic_terms) :: law
  contains
    procedure(two_to_energy), deferred :: product
    procedure :: start
    procedure :: follow
    procedure :: stored
  end type internal_state

  abstract interface
    !> x^T D y with the stiffness at E_R [J for x, y in m, rad].
    pure real(wp) function two_to_energy(self, n, x, y) result(total)   ! [J]
      import :: internal_state, wp
      class(internal_state), intent(in) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n), y(n)      !! deformations, internal variables or their rates [m, rad, ...]
    end function two_to_energy
  end interface

contains

  !> Where the variables of a term begin, from 0.
  elemental integer function start(self, k)
    class(internal_state), intent(in) :: self
    integer, intent(in) :: k                  !! term
    start = self%offset + (k - 1)*self%width
    if (k > self%law%second) start = self%first_order + (k - 1 - self%law%second)*self%width
  end function start

  !> Highest derivatives of the variables; adds their differences alpha (d - z) to ds, what they dissipate to the power.
  pure subroutine follow(self, n, d, z, zd, zdd, ds, apart, power)
    class(internal_state), intent(in) :: self
    integer, intent(in) :: n                  !! coordinates of one term
    real(wp), intent(in) :: d(n)              !! deformations [m, rad]
    real(wp), intent(in) :: z(*), zd(*)       !! (nz), (nzd) of the scene [m, rad], [m/s, rad/s]
    real(wp), intent(inout) :: zdd(*)         !! (nz) [m/s2, rad/s2], [m/s, rad/s]
    real(wp), intent(inout) :: ds(n)          !! [m, rad]
    integer, intent(in) :: apart              !! 1: the power of each term apart, 0: of all together
    real(wp), intent(inout) :: power(*)       !! [W]
    integer :: k, o, i
    associate (law => self%law, m => self%law%second, first => self%law%first)
      do k = 1, m
        o = self%offset + (k - 1)*n + 1
        call follow_with_inertia(n, law%alpha(k), law%viscosity(k), law%inertia(k), d, z(o), zd(o), zdd(o), ds)
        i = 1 + apart*(k - 1)
        power(i) = power(i) + law%alpha(k)*law%viscosity(k)*self%product(n, zd(o), zd(o))
      end do
      do k = m + 1, m + first
        o = self%first_order + (k - m - 1)*n + 1
        call follow_without(n, law%alpha(k), law%viscosity(k), d, z(o), zdd(o), ds)
        i = 1 + apart*(k - 1)
        power(i) = power(i) + law%alpha(k)*law%viscosity(k)*self%product(n, zdd(o), zdd(o))
      end do
    end associate
  end subroutine follow

  !> One term of second order: inertia z'' + viscosity z' + z = d.
  pure subroutine follow_with_inertia(n, alpha, viscosity, inertia, d, z, zd, zdd, ds)
    integer, intent(in) :: n
    real(wp), intent(in) :: alpha             !! [-]
    real(wp), intent(in) :: viscosity         !! [s]
    real(wp), intent(in) :: inertia           !! [s2]
    real(wp), intent(in) :: d(n), z(n)        !! [m, rad]
    real(wp), intent(in) :: zd(n)             !! [m/s, rad/s]
    real(wp), intent(inout) :: zdd(n)         !! [m/s2, rad/s2]
    real(wp), intent(inout) :: ds(n)          !! [m, rad]
    real(wp) :: w2, two_zw                    ! [1/s2], [1/s]
    integer :: i
    w2 = 1/inertia
    two_zw = viscosity*w2
    do i = 1, n
      zdd(i) = w2*(d(i) - z(i)) - two_zw*zd(i)
      ds(i) = ds(i) + alpha*(d(i) - z(i))
    end do
  end subroutine follow_with_inertia

  !> One of first order, viscosity z' + z = d.
  pure subroutine follow_without(n, alpha, viscosity, d, z, zd, ds)
    integer, intent(in) :: n
    real(wp), intent(in) :: alpha             !! [-]
    real(wp), intent(in) :: viscosity         !! [s]
    real(wp), intent(in) :: d(n), z(n)        !! [m, rad]
    real(wp), intent(inout) :: zd(n)          !! [m/s, rad/s]
    real(wp), intent(inout) :: ds(n)          !! [m, rad]
    real(wp) :: rate                          ! [1/s]
    integer :: i
    rate = 1/viscosity
    do i = 1, n
      zd(i) = rate*(d(i) - z(i))
      ds(i) = ds(i) + alpha*(d(i) - z(i))
    end do
  end subroutine follow_without

  !> Energy stored beside that of the static stiffness, alpha/2 ((d - z)^T D (d - z) + inertia z'^T D z') of every term [J].
  pure real(wp) function stored(self, n, d, z, zd) result(energy)
    class(internal_state), intent(in) :: self
    integer, intent(in) :: n                  !! coordinates of one term
    real(wp), intent(in) :: d(n)              !! deformations [m, rad]
    real(wp), intent(in) :: z(*), zd(*)       !! (nz), (nzd) of the scene [m, rad], [m/s, rad/s]
    integer :: k, o
    energy = 0.0_wp
    associate (law => self%law)
      do k = 1, law%second + law%first
        o = self%start(k) + 1
        energy = energy + 0.5_wp*law%alpha(k)*(self%product(n, d, d) - 2*self%product(n, d, z(o)) + self%product(n, z(o), z(o)))
        if (k <= law%second) energy = energy + 0.5_wp*law%alpha(k)*law%inertia(k)*self%product(n, zd(o), zd(o))
      end do
    end associate
  end function stored
end module internal_variables
