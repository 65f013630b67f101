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
    real(wp) :: lost                          ! over weight and viscosity [J/s2]
    integer :: k, o, i
    associate (law => self%law, m => self%law%second)
      do k = 1, m + law%first
        if (k <= m) then
          o = self%offset + (k - 1)*n + 1
          call follow_term(n, law%alpha(k), 1/law%inertia(k), law%viscosity(k)/law%inertia(k), d, z(o), zd(o), zdd(o), ds)
          lost = self%product(n, zd(o), zd(o))
        else
          o = self%first_order + (k - m - 1)*n + 1
          call follow_term(n, law%alpha(k), 1/law%viscosity(k), 0.0_wp, d, z(o), z(o), zdd(o), ds)
          lost = self%product(n, zdd(o), zdd(o))
        end if
        i = 1 + apart*(k - 1)
        power(i) = power(i) + law%alpha(k)*law%viscosity(k)*lost
      end do
    end associate
  end subroutine follow

  !> One term: its highest derivative is stiff (d - z) - damped z'.
  pure subroutine follow_term(n, alpha, stiff, damped, d, z, zd, zdd, ds)
    integer, intent(in) :: n
    real(wp), intent(in) :: alpha             !! [-]
    real(wp), intent(in) :: stiff             !! [1/s2]; of first order [1/s]
    real(wp), intent(in) :: damped            !! [1/s]; of first order 0
    real(wp), intent(in) :: d(n), z(n)        !! [m, rad]
    real(wp), intent(in) :: zd(n)             !! [m/s, rad/s]; of first order anything
    real(wp), intent(inout) :: zdd(n)         !! [m/s2, rad/s2], [m/s, rad/s]
    real(wp), intent(inout) :: ds(n)          !! [m, rad]
    integer :: i
    do i = 1, n
      zdd(i) = stiff*(d(i) - z(i)) - damped*zd(i)
      ds(i) = ds(i) + alpha*(d(i) - z(i))
    end do
  end subroutine follow_term

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
