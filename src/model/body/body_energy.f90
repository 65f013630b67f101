!> Energies of one body (theory.md, sections 2, 4, 5). Used at output times only.
module body_energy
  use kinds, only: wp
  use body, only: body_model, elastic_work
  use elastic_operators, only: bilinear
  implicit none (type, external)
  private
  public :: kinetic_energy, layer_energy, strain_energy

contains

  !> Kinetic energy of a body from its frame's state and its elastic coordinates.
  real(wp) function kinetic_energy(b, c, s, v, qf, vf) result(energy)   ! [J]
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: c, s              !! of the frame angle [-]
    real(wp), intent(in) :: v(3)              !! frame rates: global x, y [m/s] and angle [rad/s]
    real(wp), intent(in), contiguous :: qf(:), vf(:)   !! (nf) elastic coordinates and rates [m, rad] and per second
    real(wp) :: p(2), w(2), mtt, cross
    w(1) = c*v(1) + s*v(2)                    ! velocity of the origin in body axes
    w(2) = c*v(2) - s*v(1)
    p = b%i1
    mtt = b%i11
    cross = 0.0_wp
    energy = 0.0_wp
    if (b%flexible) then
      p = p + b%shape%moment(qf)
      mtt = mtt + 2*dot_product(b%shape%i1f, qf) + bilinear(b%op%symmetric, b%op%m, qf, qf)
      cross = dot_product(b%shape%c0, vf) + bilinear(b%op%skew, b%op%z, qf, vf)
      energy = dot_product(w, b%shape%moment(vf)) + 0.5_wp*bilinear(b%op%symmetric, b%op%m, vf, vf)
      if (b%op%rotary) energy = energy + 0.5_wp*bilinear(b%op%symmetric, b%op%j, vf, vf)
    end if
    energy = energy + 0.5_wp*b%mass*dot_product(w, w) + v(3)*(w(2)*p(1) - w(1)*p(2)) + 0.5_wp*mtt*v(3)**2 + v(3)*cross
  end function kinetic_energy

  !> Strain energy with what viscoelastic terms store [J].
  real(wp) function strain_energy(b, w, qf, z, zd) result(energy)   ! [J]
    type(body_model), intent(in) :: b
    type(elastic_work), intent(in) :: w       !! of an evaluation of this state
    real(wp), intent(in) :: qf(:)             !! (nf) [m, rad]
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz), (nzd) internal variables of the scene [m, rad] and per second
    integer :: r
    energy = 0.0_wp
    if (.not. b%flexible) return
    energy = 0.5_wp*sum(b%basis%strain_parts(b, qf, w%d))
    do r = 1, size(b%segments)
      energy = energy + b%segments(r)%stored(b%segments(r)%width, w%d(1, b%segments(r)%first), z, zd)
    end do
  end function strain_energy

  !> What of it one layer stores; of modes a viscoelastic material has to be in one layer.
  real(wp) function layer_energy(b, layer, w, z, zd) result(energy)   ! [J]
    type(body_model), intent(in) :: b
    integer, intent(in) :: layer
    type(elastic_work), intent(in) :: w       !! of an evaluation of this state
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz), (nzd) internal variables of the scene [m, rad] and per second
    type(elastic_work) :: rest                ! without the terms' differences
    integer :: e, r
    rest = w
    rest%ds = w%d
    energy = 0.0_wp
    do e = 1, b%ne
      associate (kind => b%layers%kinds(b%layers%kind(e)))
        energy = energy + 0.5_wp*sum(kind%stiffness*b%basis%element_strain(b, e, rest)**2, kind%layer == layer)
      end associate
    end do
    do r = 1, size(b%segments)
      if (b%segments(r)%layer == layer) energy = energy + b%segments(r)%stored(b%segments(r)%width, &
                                                                              w%d(1, b%segments(r)%first), z, zd)
    end do
  end function layer_energy
end module body_energy
