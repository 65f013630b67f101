!> Motion of the frames and of the markers on bodies, from the coordinates and their rates (theory.md, section 6).
module marker_motion
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use force_element, only: on_a_piece
  use mechanism, only: mechanism_model
  use marker, only: add_modes, marker_model, marker_states, turn
  implicit none (type, external)
  private
  public :: set_frames, marker_kinematics, marker_displacement, one_marker

contains

  !> Cosines and sines of the frame angles.
  pure subroutine set_frames(self, ev, q)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:)          !! (nq) [m, rad]
    real(wp) :: angle
    integer :: b
    do b = 1, size(ev%frame%cos)
      angle = q(self%s%qo(b) + 3)
      if (abs(angle - ev%frame%angle(b)) <= 0.0_wp) cycle   ! most evaluations at the end of a step are of the same positions
      ev%frame%angle(b) = angle
      ev%frame%cos(b) = cos(angle)
      ev%frame%sin(b) = sin(angle)
    end do
  end subroutine set_frames

  !> States of all markers, frames first.
  pure subroutine marker_kinematics(self, ev, q, v)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:)    !! (nq) [m, rad], [m/s, rad/s]
    integer :: j, k, b, i, n
    call set_frames(self, ev, q)
    associate (at => self%markers, f => ev%frame, p => ev%p)
      if (size(at%rigid) > 0) call rigid_markers(size(at%rigid), at%rigid, size(at%body), size(f%cos), at%body, self%s%qo, f%cos, &
                                                 f%sin, size(q), q, v, p%rho, p%r, p%v, p%bias, p%angle, p%rate)
      if (size(at%nodal) > 0) call nodal_markers(size(at%nodal), at%nodal, size(at%body), size(f%cos), at%body, self%s%qo, at%dof, &
                                                 at%x, f%cos, f%sin, size(q), q, v, p%rho, p%r, p%v, p%bias, p%angle, p%rate)
    end associate
    do j = 1, size(self%markers%modal)
      k = self%markers%modal(j)
      b = self%markers%body(k)
      i = self%s%qo(b)
      n = self%s%bodies(b)%nf
      call one_marker(self%s%markers(k), ev%frame%cos(b), ev%frame%sin(b), q(i + 1:i + 3), v(i + 1:i + 3), n, &
                      q(i + 4:i + 3 + n), v(i + 4:i + 3 + n), ev%p, k)
    end do
    n = size(self%s%switching) - size(self%s%corners)
    if (n < size(self%s%switching)) ev%p%piece = merge(ev%switches%event_value(n + 1:size(self%s%switching)), huge(1.0_wp), &
                                                       ev%switches%state(n + 1:size(self%s%switching)) == on_a_piece)
  end subroutine marker_kinematics

  !> States of the markers on rigid bodies, whose rho is constant.
  pure subroutine rigid_markers(n, list, np, nb, body, offset, c, s, nq, q, v, rho, r, rv, bias, angle, rate)
    integer, intent(in) :: n, np, nb, nq
    integer, intent(in) :: list(n)                    !! these markers
    integer, intent(in) :: body(np)                   !! of each marker
    integer, intent(in) :: offset(nb)                 !! of each body's coordinates
    real(wp), intent(in) :: c(nb), s(nb)              !! of the frame angles [-]
    real(wp), intent(in) :: q(nq), v(nq)              !! [m, rad], [m/s, rad/s]
    real(wp), intent(in) :: rho(2, np)                !! body axes [m]
    real(wp), intent(inout) :: r(2, np), rv(2, np), bias(2, np), angle(np), rate(np)   !! as marker_states [m, rad, per s, s2]
    real(wp) :: x(2), w
    integer :: j, k, b, i
    do j = 1, n
      k = list(j)
      b = body(k)
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
  end subroutine rigid_markers

  !> States of the markers on flexible bodies in nodal coordinates (theory.md, section 6).
  pure subroutine nodal_markers(n, list, np, nb, body, offset, dof, x, c, s, nq, q, v, rho, r, rv, bias, angle, rate)
    integer, intent(in) :: n, np, nb, nq
    integer, intent(in) :: list(n)                    !! these markers
    integer, intent(in) :: body(np)                   !! of each marker
    integer, intent(in) :: offset(nb)                 !! of each body's coordinates
    integer, intent(in) :: dof(3, np)                 !! elastic coordinates of each marker, 0: none
    real(wp), intent(in) :: x(2, np)                  !! undeformed, body axes [m]
    real(wp), intent(in) :: c(nb), s(nb)              !! of the frame angles [-]
    real(wp), intent(in) :: q(nq), v(nq)              !! [m, rad], [m/s, rad/s]
    real(wp), intent(inout) :: rho(2, np)             !! body axes [m]
    real(wp), intent(inout) :: r(2, np), rv(2, np), bias(2, np), angle(np), rate(np)   !! as marker_states [m, rad, per s, s2]
    real(wp) :: u(3), ud(3)
    integer :: j, k, b, i, m
    do j = 1, n
      k = list(j)
      b = body(k)
      i = offset(b)
      u = 0.0_wp
      ud = 0.0_wp
      do m = 1, 3
        if (dof(m, k) == 0) cycle
        u(m) = q(i + 3 + dof(m, k))
        ud(m) = v(i + 3 + dof(m, k))
      end do
      rho(1, k) = x(1, k) + u(1)
      rho(2, k) = x(2, k) + u(2)
      call move_marker(c(b), s(b), q(i + 1), v(i + 1), rho(1, k), u(3), ud, r(1, k), rv(1, k), bias(1, k), angle(k), rate(k))
    end do
  end subroutine nodal_markers

  !> Global position, velocity, velocity-dependent acceleration, angle and rate of a marker (theory.md, section 6).
  pure subroutine move_marker(c, s, q, v, rho, rotation, ud, r, rv, bias, angle, rate)
    real(wp), intent(in) :: c, s            !! of the frame angle [-]
    real(wp), intent(in) :: q(3), v(3)      !! frame: x, y, angle and rates [m, rad], [m/s, rad/s]
    real(wp), intent(in) :: rho(2)          !! x + u in body axes [m]
    real(wp), intent(in) :: rotation        !! elastic rotation [rad]
    real(wp), intent(in) :: ud(3)           !! rates of u, v, rotation [m/s, rad/s]
    real(wp), intent(out) :: r(2), rv(2), bias(2), angle, rate   !! as marker_states [m, rad, per s, s2]
    real(wp) :: rel(2), b(2), w
    w = v(3)
    rel(1) = ud(1) - w*rho(2)
    rel(2) = ud(2) + w*rho(1)
    b(1) = -w**2*rho(1) - 2*w*ud(2)
    b(2) = -w**2*rho(2) + 2*w*ud(1)
    r(1) = q(1) + c*rho(1) - s*rho(2)
    r(2) = q(2) + s*rho(1) + c*rho(2)
    rv(1) = v(1) + c*rel(1) - s*rel(2)
    rv(2) = v(2) + s*rel(1) + c*rel(2)
    bias(1) = c*b(1) - s*b(2)
    bias(2) = s*b(1) + c*b(2)
    angle = q(3) + rotation
    rate = w + ud(3)
  end subroutine move_marker

  !> Displacement of a marker, global axes, and turn of its section, from a change of the coordinates; of the ground none.
  pure function marker_displacement(self, ev, k, dq) result(d)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                !! marker
    real(wp), intent(in), contiguous :: dq(:)   !! (nq) [m, rad], or its derivatives
    real(wp) :: d(3)                        !! [m, m, rad], likewise
    integer :: b, i
    d = 0.0_wp
    b = self%markers%body(k)
    if (b == 0) return
    i = self%s%qo(b)
    d = self%s%markers(k)%elastic(dq(i + 4:i + 3 + self%s%bodies(b)%nf))
    d(1:2) = ev%frame%to_global(b, d(1:2) + dq(i + 3)*turn(ev%p%rho(:, k)))
    d = d + dq(i + 1:i + 3)
  end function marker_displacement

  !> State of one marker (theory.md, section 6).
  pure subroutine one_marker(marker, c, s, q, v, nf, qf, vf, p, k)
    type(marker_model), intent(in) :: marker
    real(wp), intent(in) :: c, s            !! of the frame angle [-]
    real(wp), intent(in) :: q(3), v(3)      !! frame: x, y, angle and rates [m, rad], [m/s, rad/s]
    integer, intent(in) :: nf
    real(wp), intent(in) :: qf(nf), vf(nf)  !! elastic coordinates and rates [m, rad], [m/s, rad/s]
    type(marker_states), intent(inout) :: p
    integer, intent(in) :: k                !! entry of p to fill
    real(wp) :: u(3), ud(3)
    if (allocated(marker%psi)) then
      u = 0.0_wp
      ud = 0.0_wp
      call add_modes(nf, marker%psi, qf, u)
      call add_modes(nf, marker%psi, vf, ud)
    else
      u = marker%elastic(qf)
      ud = marker%elastic(vf)
    end if
    p%rho(:, k) = marker%x + u(1:2)
    call move_marker(c, s, q, v, p%rho(:, k), u(3), ud, p%r(:, k), p%v(:, k), p%bias(:, k), p%angle(k), p%rate(k))
  end subroutine one_marker
end module marker_motion
