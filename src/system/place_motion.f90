!> Motion of the frames and of the places on bodies, from the coordinates and their rates (theory.md, section 6).
module place_motion
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use place, only: place_model, place_states
  implicit none (type, external)
  private
  public :: set_frames, place_kinematics, one_place

contains

  !> Cosines and sines of the frame angles.
  pure subroutine set_frames(self, q)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in), contiguous :: q(:)          !! (nq)
    real(wp) :: angle
    integer :: b
    do b = 1, size(self%c)
      angle = q(self%s%qo(b) + 3)
      self%c(b) = cos(angle)
      self%sn(b) = sin(angle)
    end do
  end subroutine set_frames

  !> States of all places.
  pure subroutine place_kinematics(self, q, v)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq)
    integer :: j, k, b, i, n
    call rigid_places(size(self%place_body), size(self%c), self%place_body, self%flexible, self%s%qo, self%c, self%sn, &
                      size(q), q, v, self%p%rho, self%p%r, self%p%v, self%p%bias, self%p%angle, self%p%rate)
    do j = 1, size(self%flexible_places)
      k = self%flexible_places(j)
      b = self%place_body(k)
      i = self%s%qo(b)
      n = self%s%bodies(b)%nf
      call one_place(self%s%places(k), self%c(b), self%sn(b), q(i + 1:i + 3), v(i + 1:i + 3), q(i + 4:i + 3 + n), &
                     v(i + 4:i + 3 + n), self%p, k)
    end do
  end subroutine place_kinematics

  !> States of the places on rigid bodies, whose rho is constant.
  pure subroutine rigid_places(np, nb, body, flexible, offset, c, s, nq, q, v, rho, r, rv, bias, angle, rate)
    integer, intent(in) :: np, nb, nq
    integer, intent(in) :: body(np)                   !! 0: the ground
    logical, intent(in) :: flexible(nb)
    integer, intent(in) :: offset(nb)                 !! of each body's coordinates
    real(wp), intent(in) :: c(nb), s(nb)              !! of the frame angles [-]
    real(wp), intent(in) :: q(nq), v(nq)
    real(wp), intent(in) :: rho(2, np)                !! body axes [m]
    real(wp), intent(inout) :: r(2, np), rv(2, np), bias(2, np), angle(np), rate(np)   !! as in place_states
    real(wp) :: x(2), w
    integer :: k, b, i
    do k = 1, np
      b = body(k)
      if (b == 0) cycle
      if (flexible(b)) cycle
      i = offset(b)
      x(1) = c(b)*rho(1, k) - s(b)*rho(2, k)
      x(2) = s(b)*rho(1, k) + c(b)*rho(2, k)
      w = v(i + 3)
      r(1, k) = q(i + 1) + x(1)
      r(2, k) = q(i + 2) + x(2)
      rv(1, k) = v(i + 1) - w*x(2)
      rv(2, k) = v(i + 2) + w*x(1)
      bias(1, k) = -w**2*x(1)
      bias(2, k) = -w**2*x(2)
      angle(k) = q(i + 3)
      rate(k) = w
    end do
  end subroutine rigid_places

  !> State of one place (theory.md, section 6).
  pure subroutine one_place(place, c, s, q, v, qf, vf, p, k)
    type(place_model), intent(in) :: place
    real(wp), intent(in) :: c, s            !! of the frame angle [-]
    real(wp), intent(in) :: q(3), v(3)      !! frame: x, y, angle and rates
    real(wp), intent(in), contiguous :: qf(:), vf(:)  !! elastic coordinates and rates
    type(place_states), intent(inout) :: p
    integer, intent(in) :: k                !! entry of p to fill
    real(wp) :: u(3), ud(3), rho(2), rel(2), bias(2)
    integer :: i
    u = 0.0_wp
    ud = 0.0_wp
    if (allocated(place%psi)) then
      do i = 1, size(qf)
        u = u + place%psi(:, i)*qf(i)
        ud = ud + place%psi(:, i)*vf(i)
      end do
    else
      do i = 1, 3
        if (place%dof(i) == 0) cycle
        u(i) = qf(place%dof(i))
        ud(i) = vf(place%dof(i))
      end do
    end if
    rho = place%x + u(1:2)
    rel(1) = ud(1) - v(3)*rho(2)
    rel(2) = ud(2) + v(3)*rho(1)
    bias(1) = -v(3)**2*rho(1) - 2*v(3)*ud(2)
    bias(2) = -v(3)**2*rho(2) + 2*v(3)*ud(1)
    p%rho(:, k) = rho
    p%r(1, k) = q(1) + c*rho(1) - s*rho(2)
    p%r(2, k) = q(2) + s*rho(1) + c*rho(2)
    p%v(1, k) = v(1) + c*rel(1) - s*rel(2)
    p%v(2, k) = v(2) + s*rel(1) + c*rel(2)
    p%bias(1, k) = c*bias(1) - s*bias(2)
    p%bias(2, k) = s*bias(1) + c*bias(2)
    p%angle(k) = q(3) + u(3)
    p%rate(k) = v(3) + ud(3)
  end subroutine one_place
end module place_motion
