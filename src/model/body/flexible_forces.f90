!> The explicit forces of a flexible body on its elastic coordinates: inertia, elastic and viscoelastic forces, Rayleigh damping.
!> Nothing is allocated; a kind is asked once a body or a segment, never for an element.
module flexible_forces
  use kinds, only: wp
  use body, only: body_model, elastic_work
  use elastic_operators, only: damping_forces, inertia_forces
  use segment_model, only: viscoelastic_segment
  implicit none (type, external)
  private
  public :: elastic_forces

contains

  !> Adds to w%force theta'^2 m q + 2 theta' Z q' - dV/dq - C q' - terms' forces, and to w%coupling -Z q (theory.md, section 3).
  !> On entry w%q, w%v hold the coordinates and rates.
  subroutine elastic_forces(b, segments, z, zd, thetad, w, zdd, qmq, qmv, loss, power)
    type(body_model), intent(in) :: b       !! the body, or one with the same constants, which are then read once for many bodies
    type(viscoelastic_segment), intent(in) :: segments(:)   !! the body's own
    real(wp), intent(in) :: z(*), zd(*)     !! (nz) internal variables, (nzd) rates of those of second order [m, rad] and per s
    real(wp), intent(in) :: thetad          !! frame rate [rad/s]
    type(elastic_work), intent(inout) :: w
    real(wp), intent(inout) :: zdd(*)       !! (nz) their highest derivatives [m/s2, rad/s2], [m/s, rad/s]
    real(wp), intent(out) :: qmq, qmv       !! q^T m q [kg m2] and q^T m q' [kg m2/s], translational part of m_ff
    real(wp), intent(inout) :: loss(*)      !! power dissipated by each term of each material [W]
    real(wp), intent(out) :: power          !! dissipated by Rayleigh damping [W]
    integer :: r
    power = 0.0_wp
    call b%basis%deform(b, w%q, w%d)
    call copy_values(size(w%d), w%d, w%ds)
    do r = 1, size(segments)
      associate (segment => segments(r))
        call segment%follow(segment%width, w%d(1, segment%first), z, zd, zdd, w%ds(1, segment%first), 1, &
                            loss(segment%losses + 1))
      end associate
    end do
    call inertia_forces(b%op, b%nf, thetad, w%q(1), w%v(1), w%force(1), w%coupling(1), qmq, qmv)
    call b%basis%add_stress(b, w%d, w%ds, w%q, -1.0_wp, w%force)
    if (b%rayleigh) call damping_forces(b%op, b%nf, w%v(1), w%force(1), power)
  end subroutine elastic_forces

  !> y = x, as one piece of memory.
  pure subroutine copy_values(n, x, y)
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n)            !! [any]
    real(wp), intent(out) :: y(n)           !! [any]
    y = x
  end subroutine copy_values
end module flexible_forces
