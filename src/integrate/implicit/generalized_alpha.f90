!> The generalized-alpha method (Chung & Hulbert 1993) in the form of Arnold & Bruels (2007) for constrained systems: the
!> equations hold at the end of every step, and a sequence a of acceleration-like variables follows the accelerations v',
!>
!>   q1 = q + h v + h2 (1/2 - beta) a + h2 beta a1        v1 = v + h (1 - gamma) a + h gamma a1
!>   (1 - alpha_m) a1 + alpha_m a = (1 - alpha_f) v1' + alpha_f v'
!>
!> Coefficients only; what the equations are is the caller's business.
module generalized_alpha
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: alpha_method, alpha_step, chung_hulbert, step_coefficients

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

contains

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
end module generalized_alpha
