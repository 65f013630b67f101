!> The generalized-alpha method (Chung & Hulbert 1993) in the form of Arnold & Bruels (2007) for constrained systems: the
!> equations hold at the end of every step, and a sequence a of acceleration-like variables follows the accelerations v',
!>
!>   q1 = q + h v + h2 (1/2 - beta) a + h2 beta a1        v1 = v + h (1 - gamma) a + h gamma a1
!>   (1 - alpha_m) a1 + alpha_m a = (1 - alpha_f) v1' + alpha_f v'
!>
!> The state of the generalized-alpha method from step to step, and its checkpoint. Positions x hold the coordinates, then the
!> internal variables; both follow the same relations.
module alpha_state
  use kinds, only: wp, ip
  use archive, only: value_archive
  use second_order_system, only: second_order_ode
  use step_control, only: error_norm, least_scale
  implicit none (type, external)
  private
  public :: set_up_alpha, pack, exchange_alpha, chung_hulbert, step_coefficients

  !> The method of one spectral radius.
  type :: alpha_method
    real(wp) :: rho = 0.9_wp            !! spectral radius at infinite frequency [-]
    real(wp) :: alpha_m = 0.0_wp        !! [-]
    real(wp) :: alpha_f = 0.0_wp        !! [-]
    real(wp) :: gamma = 0.5_wp          !! [-]
    real(wp) :: beta = 0.25_wp          !! [-]
    real(wp) :: lag = 0.0_wp            !! a follows v'(t + lag h) [-]
    real(wp) :: offset = 0.0_wp         !! v of an index-3 solution is off the manifold by offset h2 q''' [-]
  end type alpha_method

  !> Its coefficients for one step size.
  type :: alpha_step
    real(wp) :: h = 0.0_wp              !! [s]
    real(wp) :: c1 = 0.0_wp             !! d v1'/d q1 [1/s2]
    real(wp) :: c2 = 0.0_wp             !! d v1/d q1 [1/s]
    real(wp) :: qa = 0.0_wp             !! h2 (1/2 - beta) [s2]
    real(wp) :: qa1 = 0.0_wp            !! h2 beta [s2]
    real(wp) :: va = 0.0_wp             !! h (1 - gamma) [s]
    real(wp) :: va1 = 0.0_wp            !! h gamma [s]
    real(wp) :: ad1 = 0.0_wp            !! a1 = ad1 v1' + (1 - ad1 - aa) v' + aa a [-]
    real(wp) :: aa = 0.0_wp             !! [-]
  end type alpha_step

  !> Newton's method in the last steps, and its counts.
  type, public :: newton_memory
    real(wp) :: contraction = 1.0_wp         !! of corrections when it was measured last; 1: unknown [-]
    real(wp) :: first = 0.0_wp               !! first correction of that step, scaled [-]
    logical :: exact = .false.               !! that step used the exact matrix
    integer :: steps = 0                     !! steps since then
    integer :: exact_left = 0                !! steps that still use the exact matrix
    integer(ip) :: iterations = 0            !! of all steps
    integer(ip) :: factors(2) = 0            !! factorisations of constant and of full elastic blocks
    real(wp) :: h = 0.0_wp                   !! size of the last step, 0: none [s]
    real(wp), allocatable :: change(:)       !! (nq) of the accelerations in it [m/s2, rad/s2]
  end type newton_memory

  !> Energies.
  type, public :: energy_sums
    real(wp), allocatable :: sums(:)         !! (quadratures) dissipated, put in, and others [J]
    real(wp), allocatable :: powers(:)       !! the same [W]
    real(wp), allocatable :: next(:)         !! (quadratures) work: powers at the end of the trial step [W]
    real(wp) :: removed = 0.0_wp             !! dissipated by the method itself [J]
    real(wp), allocatable :: pairs(:, :)     !! (nq + nz, 4) work space of that [m, rad] and per second
  end type energy_sums

  !> The method's variables.
  type, public :: alpha_solver
    type(alpha_method) :: method
    type(alpha_step) :: now                  !! coefficients of the step that the factors stand for
    integer :: nq = 0, nz = 0, nzd = 0       !! coordinates, internal variables, those of second order
    real(wp), allocatable :: x(:), v(:), vd(:)         !! (nq + nz) with phi = phi' = phi'' = 0 [m, rad] and per second
    real(wp), allocatable :: lag(:)          !! (nq + nz) a is v' + h lag [m/s3, rad/s3]
    real(wp), allocatable :: offset(:)       !! (nq) a step's rates begin at v - offset, for v'' along the constraints [m/s, rad/s]
    real(wp), allocatable :: offset1(:)      !! (nq) the same of the next step [m/s, rad/s]
    real(wp), allocatable :: x1(:), v1(:), vd1(:)      !! (nq + nz) the trial step [m, rad] and per second
    real(wp), allocatable :: lambda(:), lambda1(:)     !! (rows) [N]
    real(wp), allocatable :: dx(:), dlambda(:)         !! (nq + nz), (rows) corrections [m, rad], [N]
    real(wp), allocatable :: r(:)            !! (nq) residual of motion [N, N m]
    real(wp), allocatable :: gaps(:, :)      !! (rows, 0:3) rows, their derivatives, the offset's rates [m], [m/s], [m/s2], [m/s]
    real(wp), allocatable :: closing(:, :), closing_lambda(:, :)     !! (nq, 3), (rows, 3) what closes them [m, rad], [N] per s, s2
    real(wp), allocatable :: gain(:)         !! (nz) dz/d(deformation) in this step: 1/(1 + viscosity c2 + inertia c1) [-]
    real(wp), allocatable :: resolved(:)     !! (nz) the part of their motion that the step resolves: 1 slow, 0 much faster [-]
    type(energy_sums) :: energy
    real(wp) :: h_tried = 0.0_wp             !! length of the trial step [s]
    logical :: needs_factors = .false.   !! restored: factors are to be made again
    real(wp), allocatable :: by_group(:)     !! (nq) one over the largest value of each one's group so far [1/m, 1/rad]
    real(wp), allocatable :: by_scene(:)     !! (nq) one over the scene's size or one radian [1/m, 1/rad]
    type(newton_memory) :: newton
  end type alpha_solver

contains

  !> Prepares the variables for one spectral radius.
  subroutine set_up_alpha(self, system, method, norm)
    type(alpha_solver), intent(out) :: self
    class(second_order_ode), intent(in) :: system
    type(alpha_method), intent(in) :: method
    type(error_norm), intent(in) :: norm
    integer :: n
    self%method = method
    self%nq = system%nq
    self%nz = system%nz
    self%nzd = system%nzd
    n = self%nq + self%nz
    allocate (self%x(n), self%v(n), self%vd(n), self%lag(n), self%x1(n), self%v1(n), self%vd1(n), self%dx(n), &
              self%energy%pairs(n, 4), self%energy%sums(system%quadratures), self%energy%powers(system%quadratures), &
              self%energy%next(system%quadratures), source=0.0_wp)
    allocate (self%lambda(system%rows), self%lambda1(system%rows), self%dlambda(system%rows), self%gaps(system%rows, 0:3), &
              self%gain(self%nz), self%resolved(self%nz), self%offset(self%nq), self%offset1(self%nq), &
              self%closing(self%nq, 3), self%closing_lambda(system%rows, 3), self%r(self%nq), source=0.0_wp)
    allocate (self%newton%change(self%nq), source=0.0_wp)
    self%by_scene = least_scale/norm%floor(norm%group(1:self%nq))
    self%by_group = self%by_scene
  end subroutine set_up_alpha

  !> Positions and rates, or rates and accelerations, with quadratures or their rates, in the system's layout.
  pure subroutine pack(self, x, v, sums, y)
    type(alpha_solver), intent(in) :: self
    real(wp), intent(in) :: x(:), v(:)       !! (nq + nz) [m, rad] and per second
    real(wp), intent(in) :: sums(:)          !! (quadratures) [J] or [W]
    real(wp), intent(inout) :: y(:)          !! (n) [unit of each unknown]
    associate (nq => self%nq, nz => self%nz, nzd => self%nzd)
      y(1:nq) = x(1:nq)
      y(nq + 1:2*nq) = v(1:nq)
      y(2*nq + 1:2*nq + nz) = x(nq + 1:)
      y(2*nq + nz + 1:2*nq + nz + nzd) = v(nq + 1:nq + nzd)
      y(2*nq + nz + nzd + 1:) = sums
    end associate
  end subroutine pack

  !> Saves or restores the method's variables; the factors of the step, functions of its size, are made again.
  subroutine exchange_alpha(self, a)
    type(alpha_solver), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%now%h)
    if (.not. a%saving) self%now = step_coefficients(self%method, self%now%h)
    call a%exchange(self%energy%removed, self%newton%h, self%newton%contraction, self%newton%first, self%newton%exact)
    call a%exchange(self%newton%steps, self%newton%exact_left)
    call a%exchange(self%x, self%v, self%vd, self%lag)
    call a%exchange(self%offset, self%lambda, self%energy%sums, self%energy%powers)
    call a%exchange(self%newton%change)
    call a%exchange(self%newton%iterations, self%newton%factors(1), self%newton%factors(2))
    if (.not. a%saving) self%needs_factors = .true.
  end subroutine exchange_alpha

  !> Parameters of a spectral radius (Chung & Hulbert 1993, eq. 25).
  pure function chung_hulbert(rho) result(m)
    real(wp), intent(in) :: rho         !! 0 to below 1 [-]
    type(alpha_method) :: m
    m%rho = rho
    m%alpha_m = (2*rho - 1)/(rho + 1)
    m%alpha_f = rho/(rho + 1)
    m%gamma = 0.5_wp + m%alpha_f - m%alpha_m
    m%beta = 0.25_wp*(m%gamma + 0.5_wp)**2
    m%lag = m%alpha_m - m%alpha_f
    m%offset = m%beta + m%lag/2 - 1.0_wp/6.0_wp   ! q1 - (q + h v + ...) of exact values; Arnold, Bruels & Cardona (2015)
  end function chung_hulbert

  !> The coefficients of a step size.
  pure function step_coefficients(m, h) result(s)
    type(alpha_method), intent(in) :: m
    real(wp), intent(in) :: h           !! [s]
    type(alpha_step) :: s
    s%h = h
    s%qa = h**2*(0.5_wp - m%beta)
    s%qa1 = h**2*m%beta
    s%va = h*(1 - m%gamma)
    s%va1 = h*m%gamma
    s%ad1 = (1 - m%alpha_f)/(1 - m%alpha_m)
    s%aa = -m%alpha_m/(1 - m%alpha_m)
    s%c1 = (1 - m%alpha_m)/(1 - m%alpha_f)/s%qa1
    s%c2 = s%va1/s%qa1
  end function step_coefficients
end module alpha_state
