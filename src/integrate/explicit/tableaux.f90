!> The explicit Runge-Kutta methods, as data: Butcher tableaux, weights of the solution within a step, and for step control those of
!> the embedded error estimate and of the continuous extension. Everything else about a method follows from these. The cubic within
!> a step has order 3: its weights w of the square meet sum w = 0, w.c = 1/2, w.c2 = 0, w.A c = 0.
module tableaux
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: method_tableau

  !> The methods' names in decks; bounds and advice are given for each.
  character(6), parameter, public :: method_names(2) = ['rk4   ', 'dopri5']

  !> Coefficients of the factor R(z) = sum of r(k) z^k by which a step of each multiplies y where y' = mu y and z = h mu [-].
  real(wp), parameter, public :: growth(0:6, 2) = reshape([ &
    1.0_wp, 1.0_wp, 1/2.0_wp, 1/6.0_wp, 1/24.0_wp, 0.0_wp, 0.0_wp, &
    1.0_wp, 1.0_wp, 1/2.0_wp, 1/6.0_wp, 1/24.0_wp, 1/120.0_wp, 1/600.0_wp], [7, 2])

  !> A method.
  type, public :: tableau
    integer :: stages = 0
    integer :: order = 0
    real(wp), allocatable :: a(:, :)          !! (stages, stages): column i holds the weights of stage i, a(j, i) for j < i [-]
    real(wp), allocatable :: b(:)             !! (stages) weights [-]
    real(wp), allocatable :: c(:)             !! (stages) nodes [-]
    real(wp), allocatable :: curve(:)         !! (stages) of the square in the cubic within a step [-]
    ! for step control, with the derivative at the end of the step as a last stage
    real(wp), allocatable :: error(:)         !! (stages + 1) weights less those of the embedded method [-]
    real(wp), allocatable :: dense(:)         !! (stages + 1) weights of what the extension has beside its cubic [-]
  end type tableau

contains

  !> A method by its name; without stages where there is none.
  pure function method_tableau(name) result(m)
    character(*), intent(in) :: name
    type(tableau) :: m
    select case (name)
    case ('rk4')
      m = classical_rk4()
    case ('dopri5')
      m = dormand_prince()
    case default
      m = tableau()
    end select
  end function method_tableau

  !> The classical fourth-order method (Kutta 1901).
  pure function classical_rk4() result(m)
    type(tableau) :: m
    m%stages = 4
    m%order = 4
    allocate (m%a(4, 4), source=0.0_wp)
    m%a(1, 2) = 0.5_wp
    m%a(2, 3) = 0.5_wp
    m%a(3, 4) = 1.0_wp
    m%b = [1.0_wp, 2.0_wp, 2.0_wp, 1.0_wp]/6.0_wp
    m%c = [0.0_wp, 0.5_wp, 0.5_wp, 1.0_wp]
    m%curve = [-1.5_wp, 1.0_wp, 1.0_wp, -0.5_wp]
  end function classical_rk4

  !> The pair of orders 5 and 4 of Dormand and Prince (1980), its six stages; the seventh, the derivative at the end of the
  !> step, is the first of the next one (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.5 and II.6).
  pure function dormand_prince() result(m)
    type(tableau) :: m
    m%stages = 6
    m%order = 5
    allocate (m%a(6, 6), source=0.0_wp)
    m%a(1, 2) = 1.0_wp/5.0_wp
    m%a(1:2, 3) = [3.0_wp/40.0_wp, 9.0_wp/40.0_wp]
    m%a(1:3, 4) = [44.0_wp/45.0_wp, -56.0_wp/15.0_wp, 32.0_wp/9.0_wp]
    m%a(1:4, 5) = [19372.0_wp/6561.0_wp, -25360.0_wp/2187.0_wp, 64448.0_wp/6561.0_wp, -212.0_wp/729.0_wp]
    m%a(1:5, 6) = [9017.0_wp/3168.0_wp, -355.0_wp/33.0_wp, 46732.0_wp/5247.0_wp, 49.0_wp/176.0_wp, -5103.0_wp/18656.0_wp]
    m%b = [35.0_wp/384.0_wp, 0.0_wp, 500.0_wp/1113.0_wp, 125.0_wp/192.0_wp, -2187.0_wp/6784.0_wp, 11.0_wp/84.0_wp]
    m%c = [0.0_wp, 0.2_wp, 0.3_wp, 0.8_wp, 8.0_wp/9.0_wp, 1.0_wp]
    m%curve = [-13.0_wp/6.0_wp, 0.0_wp, 50.0_wp/21.0_wp, 0.0_wp, 0.0_wp, -3.0_wp/14.0_wp]
    m%error = [71.0_wp/57600.0_wp, 0.0_wp, -71.0_wp/16695.0_wp, 71.0_wp/1920.0_wp, -17253.0_wp/339200.0_wp, 22.0_wp/525.0_wp, &
               -1.0_wp/40.0_wp]
    m%dense = [-12715105075.0_wp/11282082432.0_wp, 0.0_wp, 87487479700.0_wp/32700410799.0_wp, &
               -10690763975.0_wp/1880347072.0_wp, 701980252875.0_wp/199316789632.0_wp, -1453857185.0_wp/822651844.0_wp, &
               69997945.0_wp/29380423.0_wp]
  end function dormand_prince
end module tableaux
