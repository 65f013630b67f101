!> The law of one GHM term where a method condenses it (theory.md, sections 5 and 7): with rates and accelerations at the end of a
!> step tied to values by z1 = z + x, z1' = z' + c2 x, z1'' = z'' + c1 x, (z, z', z'') what the past predicts,
!>
!>   z1'' + 2 zeta omega z1' + omega^2 (z1 - delta) = 0
!>
!> gives x for the deformation delta there. So z1 = g delta + offset with g = omega^2/(c1 + 2 zeta omega c2 + omega^2), and the
!> stiffness that the term multiplies acts with alpha (1 - g). The same g, at c1 = -omega^2 and c2 = i omega, is a frequency's.
module ghm_law
  use kinds, only: wp
  use body, only: body_model
  use ghm_kernel, only: run_product
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: ghm_term, list_terms, term_product

  !> One term of one run of elements, of one material of a modal body, or of one spring.
  type :: ghm_term
    integer :: first = 0                     !! its first coordinate among all dissipative ones
    integer :: last = 0                      !! and the last
    integer :: body = 0, run = 0             !! whose, or
    integer :: spring = 0
    real(wp) :: alpha = 0.0_wp               !! weight [-]
    real(wp) :: two_zw = 0.0_wp              !! 2 zeta omega [1/s]
    real(wp) :: w2 = 0.0_wp                  !! omega^2 [1/s2]
    real(wp) :: compliance = 0.0_wp          !! 1/(c1 + 2 zeta omega c2 + omega^2) [s2]
  contains
    procedure :: set
    procedure :: g
    procedure :: offsets
    procedure :: increments
    procedure :: filtered
  end type ghm_term

contains

  !> All terms of a scene, in the order of the dissipative coordinates: bodies, then springs.
  subroutine list_terms(s, terms)
    type(scene), intent(in) :: s
    type(ghm_term), allocatable, intent(out) :: terms(:)
    integer :: b, r, k, n, o
    allocate (terms(s%nz))
    n = 0
    do b = 1, size(s%bodies)
      do r = 1, size(s%bodies(b)%runs)
        associate (run => s%bodies(b)%runs(r))
          do k = 1, size(run%alpha)
            n = n + 1
            o = s%zo(b) + run%offset + (k - 1)*run%width
            terms(n) = ghm_term(first=o + 1, last=o + run%width, body=b, run=r, alpha=run%alpha(k), &
                                two_zw=2*run%zeta(k)*run%omega(k), w2=run%omega(k)**2)
          end do
        end associate
      end do
    end do
    do b = 1, size(s%springs)
      associate (sp => s%springs(b))
        do k = 1, size(sp%alpha)
          n = n + 1
          terms(n) = ghm_term(first=sp%offset + k, last=sp%offset + k, spring=b, alpha=sp%alpha(k), &
                              two_zw=2*sp%zeta(k)*sp%omega(k), w2=sp%omega(k)**2)
        end do
      end associate
    end do
    terms = terms(1:n)
  end subroutine list_terms

  !> Takes the constants of a method's step.
  elemental subroutine set(self, c1, c2)
    class(ghm_term), intent(inout) :: self
    real(wp), intent(in) :: c1               !! dz''/dz [1/s2]
    real(wp), intent(in) :: c2               !! dz'/dz [1/s]
    self%compliance = 1.0_wp/(c1 + self%two_zw*c2 + self%w2)
  end subroutine set

  !> dz/d(deformation) [-].
  elemental real(wp) function g(self)
    class(ghm_term), intent(in) :: self
    g = self%w2*self%compliance
  end function g

  !> What a term's coordinates become at zero deformation, from their predictions.
  pure subroutine offsets(self, n, z, zd, zdd, x)
    class(ghm_term), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(in) :: z(n)             !! [m, rad]
    real(wp), intent(in) :: zd(n)            !! [m/s, rad/s]
    real(wp), intent(in) :: zdd(n)           !! [m/s2, rad/s2]
    real(wp), intent(inout) :: x(n)          !! [m, rad]
    integer :: i
    do i = 1, n
      x(i) = z(i) - self%compliance*(self%w2*z(i) + self%two_zw*zd(i) + zdd(i))
    end do
  end subroutine offsets

  !> The x of the head's comment.
  pure subroutine increments(self, n, d, z, zd, zdd, x)
    class(ghm_term), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(in) :: d(n)             !! deformations [m, rad]
    real(wp), intent(in) :: z(n)             !! predicted [m, rad]
    real(wp), intent(in) :: zd(n)            !! [m/s, rad/s]
    real(wp), intent(in) :: zdd(n)           !! [m/s2, rad/s2]
    real(wp), intent(inout) :: x(n)          !! [m, rad]
    integer :: i
    do i = 1, n
      x(i) = self%compliance*(self%w2*(d(i) - z(i)) - self%two_zw*zd(i) - zdd(i))
    end do
  end subroutine increments

  !> The part of motion that the step resolves: 1 for motion slow against the term's own, 0 where it is much faster [-].
  elemental real(wp) function filtered(self, c1)
    class(ghm_term), intent(in) :: self
    real(wp), intent(in) :: c1               !! [1/s2]
    filtered = c1*self%compliance
  end function filtered

  !> x^T D y with the stiffness D at E_R that the term multiplies, over its coordinates alone [J for x, y in m, rad].
  pure real(wp) function term_product(t, s, x, y) result(total)
    type(ghm_term), intent(in) :: t
    type(scene), intent(in) :: s
    real(wp), intent(in), contiguous :: x(:), y(:)   !! (t%first:t%last) deformations or their rates [m, rad, ...]
    integer :: i, j
    if (t%body == 0) then
      total = s%springs(t%spring)%stiffness*x(1)*y(1)
    else if (s%bodies(t%body)%modal) then
      total = 0.0_wp
      associate (k => s%bodies(t%body)%runs(t%run)%stiffness)
        do j = 1, size(x)
          do i = 1, size(x)
            total = total + x(i)*k(i, j)*y(j)
          end do
        end do
      end associate
    else
      associate (bo => s%bodies(t%body), run => s%bodies(t%body)%runs(t%run))
        total = run_product(bo%nd, run%last - run%first + 1, bo%factors(:, run%first:run%last), x, y)
      end associate
    end if
  end function term_product
end module ghm_law
