!> One viscoelastic term where a method condenses it (theory.md, sections 5 and 7): with rates and accelerations at the end of a
!> step tied to values by z1 = z + x, z1' = z' + c2 x, z1'' = z'' + c1 x, (z, z', z'') what the past predicts,
!>
!>   inertia z1'' + viscosity z1' + z1 = delta
!>
!> gives x for the deformation delta there. So z1 = g delta + offset with g = 1/(1 + viscosity c2 + inertia c1), and the
!> stiffness that the term multiplies acts with alpha (1 - g). The same g, at c1 = -omega^2 and c2 = i omega, is a frequency's.
module condensed_terms
  use kinds, only: wp
  use internal_variables, only: internal_state
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: condensed_term, list_terms, term_product

  !> One term of one segment of elements, of one material of a modal body, or of one force element.
  type :: condensed_term
    integer :: first = 0, last = 0           !! its first and last coordinate among all internal variables
    integer :: body = 0, segment = 0         !! that have it; 0: a force element has it
    integer :: element = 0                   !! that force element
    integer :: loss = 0                      !! of a body's term: its number among the scene's losses
    real(wp) :: alpha = 0.0_wp               !! weight [-]
    real(wp) :: viscosity = 0.0_wp           !! [s]
    real(wp) :: inertia = 0.0_wp             !! 0: the term is of first order [s2]
    real(wp) :: g = 1.0_wp                   !! dz/d(deformation) in the present step [-]
  end type condensed_term

contains

  !> All terms of a scene, those of second order before those of first order, each bodies', then force elements'.
  subroutine list_terms(s, terms)
    type(scene), intent(in) :: s
    type(condensed_term), allocatable, intent(out) :: terms(:)
    integer :: b, r, n, kind
    allocate (terms(s%nz))
    n = 0
    do kind = 2, 1, -1
      do b = 1, size(s%bodies)
        do r = 1, size(s%bodies(b)%segments)
          associate (segment => s%bodies(b)%segments(r))
            call add_terms(segment, kind == 2, condensed_term(body=b, segment=r, loss=segment%losses), terms, n)
          end associate
        end do
      end do
      do b = 1, size(s%forces)
        associate (f => s%forces(b)%item)
          call add_terms(f, kind == 2, condensed_term(element=b), terms, n)
        end associate
      end do
    end do
    terms = terms(1:n)
  end subroutine list_terms

  !> Adds the terms of one order to the list.
  pure subroutine add_terms(variables, second, owner, terms, n)
    class(internal_state), intent(in) :: variables
    logical, intent(in) :: second            !! those of second order
    type(condensed_term), intent(in) :: owner   !! names the body's segment or the force element
    type(condensed_term), intent(inout) :: terms(:)
    integer, intent(inout) :: n              !! terms in the list
    integer :: k
    associate (law => variables%law)
      do k = merge(1, law%second + 1, second), merge(law%second, law%second + law%first, second)
        n = n + 1
        terms(n) = owner
        terms(n)%first = variables%start(k) + 1
        terms(n)%last = variables%start(k) + variables%width
        terms(n)%loss = owner%loss + k
        terms(n)%alpha = law%alpha(k)
        terms(n)%viscosity = law%viscosity(k)
        terms(n)%inertia = law%inertia(k)
      end do
    end associate
  end subroutine add_terms

  !> x^T D y with the stiffness D at E_R that the term multiplies, over its coordinates alone [J for x, y in m, rad].
  pure real(wp) function term_product(t, s, x, y) result(total)
    type(condensed_term), intent(in) :: t
    type(scene), intent(in) :: s
    real(wp), intent(in), contiguous :: x(:), y(:)   !! (t%first:t%last) deformations or their rates [m, rad, ...]
    if (t%body == 0) then
      total = s%forces(t%element)%item%product(1, x, y)
    else
      total = s%bodies(t%body)%segments(t%segment)%product(size(x), x, y)
    end if
  end function term_product
end module condensed_terms
