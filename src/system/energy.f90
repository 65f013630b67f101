!> Energies of the whole mechanism (theory.md, section 5): kinetic, potential (gravity, strain and viscoelastic terms, springs).
module energy
  use kinds, only: wp
  use body_energy, only: kinetic_energy, strain_energy
  use dynamics, only: set_frames, place_kinematics
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: energies

contains

  !> Kinetic and potential energy at a state [J], and what of the latter the deformation of each body stores.
  subroutine energies(self, q, v, z, zd, kinetic, potential, strain)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq)
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz) internal variables, (nzd) rates [m, rad] and per second
    real(wp), intent(out) :: kinetic, potential
    real(wp), intent(out) :: strain(:)                !! (nb) [J]
    real(wp) :: p(2)
    integer :: b, i, n, k
    call set_frames(self, q)
    call place_kinematics(self, q, v)
    kinetic = 0.0_wp
    potential = 0.0_wp
    do b = 1, size(self%s%bodies)
      associate (bo => self%s%bodies(b))
        i = self%s%qo(b)
        n = bo%nf
        kinetic = kinetic + kinetic_energy(bo, self%c(b), self%sn(b), v(i + 1:i + 3), q(i + 4:i + 3 + n), v(i + 4:i + 3 + n))
        p = bo%i1
        do k = 1, n
          p(1) = p(1) + bo%sbar(k, 1)*q(i + 3 + k)
          p(2) = p(2) + bo%sbar(k, 2)*q(i + 3 + k)
        end do
        p = [self%c(b)*p(1) - self%sn(b)*p(2), self%sn(b)*p(1) + self%c(b)*p(2)]
        strain(b) = strain_energy(bo, q(i + 4:i + 3 + n), z, zd)
        potential = potential - dot_product(self%s%gravity, bo%mass*q(i + 1:i + 2) + p) + strain(b)
      end associate
    end do
    potential = potential + spring_energy(self, z, zd)
  end subroutine energies

  !> Energy stored in springs and their viscoelastic terms [J].
  function spring_energy(self, z, zd) result(total)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(in) :: z(:), zd(:)
    real(wp) :: total, d, dd, e(2)
    integer :: k, j, i
    total = 0.0_wp
    do k = 1, size(self%s%springs)
      associate (sp => self%s%springs(k))
        call sp%deformation(self%p, d, dd, e)
        total = total + 0.5_wp*sp%stiffness*d**2
        do j = 1, sp%law%second
          i = sp%offset + j
          total = total + 0.5_wp*sp%stiffness*sp%law%alpha(j)*((d - z(i))**2 + sp%law%inertia(j)*zd(i)**2)
        end do
        do j = 1, sp%law%first
          i = sp%first_order + j
          total = total + 0.5_wp*sp%stiffness*sp%law%alpha(sp%law%second + j)*(d - z(i))**2
        end do
      end associate
    end do
  end function spring_energy
end module energy
