!> Energies of the whole mechanism (theory.md, section 5): kinetic, potential (gravity, strain and viscoelastic terms, springs).
module energy
  use kinds, only: wp
  use body_energy, only: kinetic_energy, strain_energy
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: energies

contains

  !> Kinetic and potential energy at the state of an evaluation, and the part of the latter in the deformation of each body.
  subroutine energies(self, ev, q, v, z, zd, kinetic, potential, strain)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq) [m, rad], [m/s, rad/s]
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz) internal variables, (nzd) rates [m, rad] and per second
    real(wp), intent(out) :: kinetic, potential !! [J]
    real(wp), intent(out) :: strain(:)                !! (nb) [J]
    real(wp) :: p(2)
    integer :: b, i, n, k
    kinetic = 0.0_wp
    potential = 0.0_wp
    do b = 1, size(self%s%bodies)
      associate (body => self%s%bodies(b))
        i = self%s%qo(b)
        n = body%nf
        kinetic = kinetic + kinetic_energy(body, ev%frame%cos(b), ev%frame%sin(b), v(i + 1:i + 3), q(i + 4:i + 3 + n), &
                                           v(i + 4:i + 3 + n))
        p = body%i1
        if (n > 0) p = p + body%shape%moment(q(i + 4:i + 3 + n))
        p = ev%frame%to_global(b, p)
        strain(b) = strain_energy(body, ev%elastic(b), q(i + 4:i + 3 + n), z, zd)
        potential = potential - dot_product(self%s%gravity, body%mass*q(i + 1:i + 2) + p) + strain(b)
      end associate
    end do
    do k = 1, size(self%s%forces)
      potential = potential + self%s%forces(k)%item%energy(ev%p, z, zd)
    end do
  end subroutine energies
end module energy
