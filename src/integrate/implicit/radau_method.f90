!> The three-stage Radau IIA method of order 5 (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.5 and IV.8): its
!> coefficients, and the eigenvalues and eigenvectors of A^-1, which part the equations of the three stages into a real and a
!> complex system. All follow from A.
module radau_method
  use kinds, only: wp
  use small_matrices, only: invert3
  implicit none (type, external)
  private
  public :: radau_tableau, radau_iia, lagrange_weights

  real(wp), parameter :: root = sqrt(6.0_wp)   !! [-]

  !> The method.
  type :: radau_tableau
    real(wp) :: c(3) = [(4 - root)/10, (4 + root)/10, 1.0_wp]   !! [-]
    real(wp) :: a(3, 3) = 0.0_wp             !! [-]
    real(wp) :: w(3, 3) = 0.0_wp             !! A^-1 [-]
    complex(wp) :: mu(2) = (0.0_wp, 0.0_wp)  !! its real eigenvalue, and the one above the real axis [-]
    complex(wp) :: to(3, 2) = (0.0_wp, 0.0_wp)     !! their eigenvectors: stages are Re(to x), x the parts [-]
    complex(wp) :: from(2, 3) = (0.0_wp, 0.0_wp)   !! x = from times the stages, the second for its conjugate, too [-]
    real(wp) :: e(3) = 0.0_wp                !! embedded formula of order 3: h y'(t) is compared with -sum of e_i (Y_i - y) [-]
    real(wp) :: lead(0:3) = 0.0_wp           !! coefficient of s^3 of the cubic through 0 and the stages [-]
    real(wp) :: powers(3, 3) = 0.0_wp        !! of the changes at the stages, the cubic's coefficients of s, s^2, s^3 [-]
    real(wp) :: fifth = 0.0_wp               !! error of the quadrature for s^5 [-]
  end type radau_tableau

contains

  !> Its coefficients.
  type(radau_tableau) function radau_iia() result(r)
    complex(wp) :: left(3)
    logical :: bad
    integer :: k
    r%a = reshape([(88 - 7*root)/360, (296 + 169*root)/1800, (16 - root)/36, &
                   (296 - 169*root)/1800, (88 + 7*root)/360, (16 + root)/36, &
                   (-2 + 3*root)/225, (-2 - 3*root)/225, 1.0_wp/9], [3, 3])
    call invert3(r%a, r%w, bad)
    associate (x => 3**(1.0_wp/3))           ! roots of mu^3 - 9 mu^2 + 36 mu - 60
      r%mu = [cmplx(3 - x + x**2, 0.0_wp, wp), cmplx(3 + (x - x**2)/2, sqrt(3.0_wp)*(x + x**2)/2, wp)]
    end associate
    do k = 1, 2
      r%to(:, k) = eigenvector(r%w, r%mu(k))
      left = eigenvector(transpose(r%w), r%mu(k))
      r%from(k, :) = k*left/sum(left*r%to(:, k))
    end do
    r%e = [-(13 + 7*root)/3, (-13 + 7*root)/3, -1.0_wp/3]
    associate (s => [0.0_wp, r%c])
      do k = 0, 3
        r%lead(k) = 1/product(pack(s(k + 1) - s, [0, 1, 2, 3] /= k))
      end do
    end associate
    call invert3(reshape([r%c, r%c**2, r%c**3], [3, 3]), r%powers, bad)
    r%powers = transpose(r%powers)
    r%fifth = sum(r%a(3, :)*r%c**5) - 1.0_wp/6
  end function radau_iia

  !> The eigenvector whose last component is 1.
  pure function eigenvector(w, mu) result(x)
    real(wp), intent(in) :: w(3, 3)          !! [-]
    complex(wp), intent(in) :: mu            !! [-]
    complex(wp) :: x(3), d
    d = (w(1, 1) - mu)*(w(2, 2) - mu) - w(1, 2)*w(2, 1)
    x = [(w(1, 2)*w(2, 3) - (w(2, 2) - mu)*w(1, 3))/d, (w(2, 1)*w(1, 3) - (w(1, 1) - mu)*w(2, 3))/d, (1.0_wp, 0.0_wp)]
  end function eigenvector

  !> Weights of values at the nodes s for the polynomial's value at x.
  pure function lagrange_weights(s, x) result(w)
    real(wp), intent(in) :: s(:)             !! [-]
    real(wp), intent(in) :: x                !! [-]
    real(wp) :: w(size(s))                   !! [-]
    integer :: i, j
    do i = 1, size(s)
      w(i) = 1.0_wp
      do j = 1, size(s)
        if (j /= i) w(i) = w(i)*(x - s(j))/(s(i) - s(j))
      end do
    end do
  end function lagrange_weights
end module radau_method
