!> The joints' part of the equations of motion: unit wrenches of the constraint rows condensed onto the frames, the
!> multipliers' matrix S = Phi_q M^-1 Phi_q^T and right-hand side (theory.md, sections 6 and 7); what multipliers do to the
!> coordinates is in `joint_response`. Loops run over plain arrays; rigid bodies never touch their models.
module joint_system
  use kinds, only: wp
  use evaluation_settings, only: evaluation_options
  use evaluation_results, only: evaluation
  use marker_motion, only: marker_displacement
  use mechanism, only: mechanism_model
  use row_sides, only: side_a, side_b
  implicit none (type, external)
  private
  public :: constraint_values, row_rates, add_row_motion, row_accelerations, velocity_terms, condense_constraints
  public :: joint_accelerations, rigid_wrenches, add_frame_compliance

contains

  !> Phi, its gradients and the other parts of every constraint, from the markers' states.
  subroutine constraint_values(self, ev, options, t)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t               !! [s]
    integer :: i, k, n
    ev%rows%left_limit = options%left_limit
    n = size(ev%p%angle)
    associate (at => self%incidence)
      if (.not. ev%rows%begun) then
        do k = 1, size(self%s%constraints)
          do i = 1, self%s%constraints(k)%item%rows
            call self%s%constraints(k)%item%evaluate(i, t, ev%p, ev%rows)
          end do
        end do
        ev%rows%begun = .true.
      end if
      call plain_values(size(at%places), at%places, size(at%angles), at%angles, self%s%rows, at%row_marker, at%datum, &
                        ev%rows%na, ev%rows%sa, n, ev%p%r, ev%p%angle, ev%rows%phi)
      do k = 1, size(at%others, 2)
        call self%s%constraints(at%others(1, k))%item%evaluate(at%others(2, k), t, ev%p, ev%rows)
      end do
    end associate
    if (allocated(ev%rows%off)) call switch_rows(self, ev)
  end subroutine constraint_values

  !> Phi of plain rows.
  pure subroutine plain_values(np, places, na, angles, rows, marker, datum, n, s, nm, r, angle, phi)
    integer, intent(in) :: np, na, rows, nm
    integer, intent(in) :: places(np), angles(na), marker(2, rows)
    real(wp), intent(in) :: datum(rows)               !! [m] or [rad]
    real(wp), intent(in) :: n(2, rows), s(rows)       !! gradients by marker a [-], [m]
    real(wp), intent(in) :: r(2, nm), angle(nm)       !! of all markers [m], [rad]
    real(wp), intent(inout) :: phi(rows)              !! [m]
    integer :: k, i
    do k = 1, np
      i = places(k)
      associate (a => marker(1, i), b => marker(2, i))
        phi(i) = n(1, i)*(r(1, a) - r(1, b)) + n(2, i)*(r(2, a) - r(2, b)) - datum(i)
      end associate
    end do
    do k = 1, na
      i = angles(k)
      phi(i) = s(i)*(angle(marker(1, i)) - angle(marker(2, i)) - datum(i))
    end do
  end subroutine plain_values

  !> Which rows hold in their present states. These are measured from the position at which they began to hold. Rows that are off
  !> keep their gradients, for the forces that act along them. Stops press on their friction with the forces that act.
  subroutine switch_rows(self, ev)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer :: k
    do k = self%s%permanent + 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item, x => ev%switches)
        associate (i => c%first)
          ev%rows%off(i) = .not. c%holds(x%state(c%switch_number))
          ev%rows%phi(i) = merge(0.0_wp, c%way(x%event_value(c%switch_number), ev%rows%phi(i)), ev%rows%off(i))
        end associate
      end associate
    end do
    do k = 1, size(self%s%friction)
      associate (law => self%s%friction(k))
        if (law%element > 0) ev%rows%pressed(law%row) = ev%action(law%element)%force
      end associate
    end do
  end subroutine switch_rows

  !> Rates of all rows, Phi_q v + Phi_t [m/s].
  pure subroutine row_rates(self, ev, rate)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp), intent(out), contiguous :: rate(:)      !! (rows) [m/s]
    integer :: k
    call add_marker_terms(self%s%rows, size(ev%p%rate), self%incidence%row_marker, ev%rows%na, ev%rows%nb, ev%p%v, &
                          ev%rows%phi_t, rate)
    call add_angle_terms(self%s%rows, size(ev%p%rate), self%incidence%row_marker, ev%rows%sa, ev%rows%sb, ev%p%rate, rate)
    do k = 1, size(self%incidence%with_carrier)
      associate (i => self%incidence%with_carrier(k))
        rate(i) = rate(i) + ev%rows%sc(i)*ev%p%rate(self%incidence%carrier(k))
      end associate
    end do
    if (.not. allocated(ev%rows%off)) return
    where (ev%rows%off) rate = 0.0_wp
  end subroutine row_rates

  !> Adds Phi_q dq: how the rows change with the coordinates.
  pure subroutine add_row_motion(self, ev, dq, change)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: dq(:)         !! (nq) [m, rad], or its derivatives
    real(wp), intent(inout), contiguous :: change(:)  !! (rows) [m], likewise
    integer :: k, i
    associate (r => ev%rows, d => ev%displacement)
      do k = 1, size(self%markers%body)
        d(:, k) = marker_displacement(self, ev, k, dq)
      end do
      do i = 1, self%s%rows
        associate (a => d(:, self%incidence%row_marker(1, i)), b => d(:, self%incidence%row_marker(2, i)))
          change(i) = change(i) + (r%na(1, i)*a(1) + r%na(2, i)*a(2) + r%sa(i)*a(3)) &
                      + (r%nb(1, i)*b(1) + r%nb(2, i)*b(2) + r%sb(i)*b(3))
        end associate
      end do
      do k = 1, size(self%incidence%with_carrier)
        i = self%incidence%with_carrier(k)
        change(i) = change(i) + r%sc(i)*d(3, self%incidence%carrier(k))
      end do
    end associate
  end subroutine add_row_motion

  !> Second derivatives Phi'' of all rows [m/s2].
  pure subroutine row_accelerations(self, ev, a, x)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: a(:)          !! (nq) accelerations [m/s2, rad/s2]
    real(wp), intent(out), contiguous :: x(:)         !! (rows) [m/s2]
    call velocity_terms(self, ev, x)
    call add_row_motion(self, ev, a, x)
    if (.not. allocated(ev%rows%off)) return
    where (ev%rows%off) x = 0.0_wp
  end subroutine row_accelerations

  !> The same where nothing accelerates.
  pure subroutine velocity_terms(self, ev, x)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp), intent(out), contiguous :: x(:)         !! (rows) [m/s2]
    call add_marker_terms(self%s%rows, size(self%markers%body), self%incidence%row_marker, ev%rows%na, ev%rows%nb, ev%p%bias, &
                          ev%rows%acceleration_bias, x)
  end subroutine velocity_terms

  !> y = x + n_a.u_a + n_b.u_b of every row, u a vector at each marker.
  pure subroutine add_marker_terms(n, np, marker, na, nb, u, x, y)
    integer, intent(in) :: n, np
    integer, intent(in) :: marker(2, n)
    real(wp), intent(in) :: na(2, n), nb(2, n), u(2, np), x(n)   !! gradients [-], vectors [any], what they add to [as u]
    real(wp), intent(out) :: y(n)                                !! [as u]
    integer :: i
    do i = 1, n
      y(i) = x(i) + ((na(1, i)*u(1, marker(1, i)) + na(2, i)*u(2, marker(1, i))) &
                     + (nb(1, i)*u(1, marker(2, i)) + nb(2, i)*u(2, marker(2, i))))
    end do
  end subroutine add_marker_terms

  !> y = y + s_a u_a + s_b u_b of every row, u a number at each marker.
  pure subroutine add_angle_terms(n, np, marker, sa, sb, u, y)
    integer, intent(in) :: n, np
    integer, intent(in) :: marker(2, n)
    real(wp), intent(in) :: sa(n), sb(n), u(np)   !! gradients [m], numbers [any]
    real(wp), intent(inout) :: y(n)               !! [m times unit of u]
    integer :: i
    do i = 1, n
      y(i) = y(i) + (sa(i)*u(marker(1, i)) + sb(i)*u(marker(2, i)))
    end do
  end subroutine add_angle_terms

  !> Unit-multiplier wrenches in body axes, condensed onto the frames, and S = Phi_q M^-1 Phi_q^T.
  subroutine condense_constraints(self, ev, elastic_fixed)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: elastic_fixed     !! elastic coordinates are fixed
    integer :: b, first, last, n, pairs
    ev%elastic_fixed = elastic_fixed
    if (allocated(ev%rows%off)) call ev%schur%hold(ev%rows%off)
    call ev%schur%clear()
    call unit_wrenches(size(self%incidence%row), self%incidence%row, self%incidence%marker, self%incidence%body, &
                       self%incidence%kind, size(ev%frame%cos), ev%frame%cos, ev%frame%sin, self%s%rows, ev%rows%na, ev%rows%nb, &
                       ev%rows%sa, ev%rows%sb, ev%rows%sc, size(self%markers%body), ev%p%rho, ev%side%w, ev%side%frame_wrench)
    pairs = 0
    do b = 1, size(ev%frame%cos)
      first = self%incidence%first(b)
      last = self%incidence%first(b + 1) - 1
      n = last - first + 1
      pairs = pairs + n*(n + 1)/2
      if (n == 0 .or. .not. self%flexible(b) .or. elastic_fixed) cycle
      associate (at => self%attached(b), ey => ev%attached(b)%ey, prototype => self%attached(self%attached_prototype(b)))
        call condense_elastic(n, self%incidence%attachment(first:last), size(at%marker), prototype%ep, ey, &
                              ev%side%w(:, first:last), ev%side%frame_wrench(:, first:last))
        call add_elastic_compliance(n, self%incidence%attachment(first:last), self%incidence%row(first:last), size(at%marker), &
                                    prototype%compliance, &
                                    ev%side%w(:, first:last), self%s%rows, ev%schur%scale, &
                                    ev%schur%entry(pairs - n*(n + 1)/2 + 1:pairs), size(ev%schur%s), ev%schur%s)
      end associate
    end do
    call add_frame_compliance(size(ev%frame%cos), self%incidence%first, size(self%incidence%row), self%incidence%row, ev%frame%l, &
                              ev%frame%dinv, ev%side%frame_wrench, &
                              ev%side%g, self%s%rows, ev%schur%scale, size(ev%schur%entry), ev%schur%entry, &
                              size(ev%schur%s), ev%schur%s)
  end subroutine condense_constraints

  !> Wrenches w of unit multipliers on the bodies, in body axes, and J^T w on the frames as if the bodies were rigid.
  pure subroutine unit_wrenches(n, row, marker, body, kind, bodies, c, s, rows, na, nb, sa, sb, sc, np, rho, w, frame_wrench)
    integer, intent(in) :: n, rows, np, bodies
    integer, intent(in) :: row(n), marker(n), body(n), kind(n)
    real(wp), intent(in) :: c(bodies), s(bodies)      !! of the frame angles [-]
    real(wp), intent(in) :: na(2, rows), nb(2, rows), sa(rows), sb(rows), sc(rows)   !! gradients, as in constraint_rows [-], [m]
    real(wp), intent(in) :: rho(2, np)                                     !! positions of markers, body axes [m]
    real(wp), intent(out) :: w(3, n), frame_wrench(3, n)                   !! on the markers, on the frames [-, m]
    real(wp) :: x, y, m
    integer :: e, i, k, b
    do e = 1, n
      i = row(e)
      k = marker(e)
      b = body(e)
      if (kind(e) == side_a) then
        x = na(1, i); y = na(2, i); m = sa(i)
      else if (kind(e) == side_b) then
        x = nb(1, i); y = nb(2, i); m = sb(i)
      else
        x = 0.0_wp; y = 0.0_wp; m = sc(i)
      end if
      w(1, e) = c(b)*x + s(b)*y
      w(2, e) = c(b)*y - s(b)*x
      w(3, e) = m
      frame_wrench(1, e) = w(1, e)
      frame_wrench(2, e) = w(2, e)
      frame_wrench(3, e) = m + rho(1, k)*w(2, e) - rho(2, k)*w(1, e)
    end do
  end subroutine unit_wrenches

  !> J^T w again, where condensation has overwritten it: wrenches on markers, moved to the frame's origin.
  pure subroutine rigid_wrenches(n, marker, w, np, rho, rigid_wrench)
    integer, intent(in) :: n, np
    integer, intent(in) :: marker(n)
    real(wp), intent(in) :: w(3, n)            !! unit wrenches, body axes [-, m]
    real(wp), intent(in) :: rho(2, np)         !! [m]
    real(wp), intent(out) :: rigid_wrench(3, n) !! the same on the frames [-, m]
    integer :: e
    do e = 1, n
      rigid_wrench(1, e) = w(1, e)
      rigid_wrench(2, e) = w(2, e)
      rigid_wrench(3, e) = w(3, e) + rho(1, marker(e))*w(2, e) - rho(2, marker(e))*w(1, e)
    end do
  end subroutine rigid_wrenches

  !> Subtracts the part of the elastic coordinates from J^T w.
  pure subroutine condense_elastic(n, local, na, ep, ey, w, frame_wrench)
    integer, intent(in) :: n, na
    integer, intent(in) :: local(n)         !! attachment of each side
    real(wp), intent(in) :: ep(3, 2, na), ey(3, na)    !! as in flexible_attachments [-], [m]
    real(wp), intent(in) :: w(3, n)                    !! wrenches of unit multipliers [-, m]
    real(wp), intent(inout) :: frame_wrench(3, n)      !! on the condensed frames [-, m]
    integer :: e, j, c
    do e = 1, n
      j = local(e)
      do c = 1, 3
        frame_wrench(1, e) = frame_wrench(1, e) - ep(c, 1, j)*w(c, e)
        frame_wrench(2, e) = frame_wrench(2, e) - ep(c, 2, j)*w(c, e)
        frame_wrench(3, e) = frame_wrench(3, e) - ey(c, j)*w(c, e)
      end do
    end do
  end subroutine condense_elastic

  !> Adds w_e . (E m_ff^-1 E^T) w_f of all pairs of sides of one body to S.
  pure subroutine add_elastic_compliance(n, local, row, na, compliance, w, rows, scale, slot, ns, s)
    integer, intent(in) :: n, rows, na, ns
    integer, intent(in) :: local(n), row(n)
    integer, intent(in) :: slot(n*(n + 1)/2)           !! of these pairs (multiplier_system)
    real(wp), intent(in) :: compliance(3, 3, na, na)   !! of the body's attachments [1/kg ...]
    real(wp), intent(in) :: w(3, n), scale(rows)       !! wrenches of unit multipliers [-, m], weights of rows [-]
    real(wp), intent(inout) :: s(ns)                   !! entries of S [1/kg]
    real(wp) :: x
    integer :: e, f, c, k
    k = 0
    do e = 1, n
      do f = 1, e
        k = k + 1
        x = 0.0_wp
        do c = 1, 3
          x = x + w(c, f)*(w(1, e)*compliance(1, c, local(e), local(f)) + w(2, e)*compliance(2, c, local(e), local(f)) &
                           + w(3, e)*compliance(3, c, local(e), local(f)))
        end do
        x = x*scale(row(e))*scale(row(f))
        if (slot(k) < 0) x = 2*x
        s(abs(slot(k))) = s(abs(slot(k))) + x
      end do
    end do
  end subroutine add_elastic_compliance

  !> Adds (J^T w)^T Mc^-1 J^T w of all pairs of sides of one body to S, for every body, by g = L^-1 J^T w times the rows' scales.
  pure subroutine add_frame_compliance(nb, first, n, row, frame_l, frame_dinv, frame_wrench, g, rows, scale, pairs, slot, ns, s)
    integer, intent(in) :: nb, n, rows, pairs, ns
    integer, intent(in) :: first(nb + 1), row(n)
    integer, intent(in) :: slot(pairs)                 !! of all pairs (multiplier_system)
    real(wp), intent(in) :: frame_l(3, nb), frame_dinv(3, nb)   !! factors of the frames [1/kg ...]
    real(wp), intent(in) :: frame_wrench(3, n), scale(rows)         !! wrenches [-, m], weights [-]
    real(wp), intent(out) :: g(3, n)                                         !! L^-1 J^T w [-, m]
    real(wp), intent(inout) :: s(ns)                                         !! entries of S [1/kg]
    real(wp) :: h(3), x, j1, j2, j3
    integer :: b, e, f, i, k
    k = 0
    do b = 1, nb
      do e = first(b), first(b + 1) - 1
        j1 = frame_wrench(1, e)*scale(row(e))
        j2 = frame_wrench(2, e)*scale(row(e)) - frame_l(1, b)*j1
        j3 = frame_wrench(3, e)*scale(row(e)) - frame_l(2, b)*j1 - frame_l(3, b)*j2
        g(1, e) = j1
        g(2, e) = j2
        g(3, e) = j3
        h(1) = j1*frame_dinv(1, b)
        h(2) = j2*frame_dinv(2, b)
        h(3) = j3*frame_dinv(3, b)
        do f = first(b), e
          k = k + 1
          x = h(1)*g(1, f) + h(2)*g(2, f) + h(3)*g(3, f)
          i = slot(k)
          if (i > 0) then
            s(i) = s(i) + x
          else                               ! both markers of one row on the same body
            s(-i) = s(-i) + 2*x
          end if
        end do
      end do
    end do
  end subroutine add_frame_compliance

  !> lambda = Phi_q a_free + (second derivative at zero acceleration): what the multipliers must cancel [m/s2].
  pure subroutine joint_accelerations(self, ev)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer :: b, first, last
    call velocity_terms(self, ev, ev%lambda)
    call add_frame_terms(size(ev%frame%cos), size(self%incidence%row), self%incidence%row, self%incidence%body, &
                         ev%side%frame_wrench, ev%frame%free, self%s%rows, ev%lambda)
    do b = 1, size(ev%frame%cos)
      if (.not. self%flexible(b)) cycle
      first = self%incidence%first(b)
      last = self%incidence%first(b + 1) - 1
      call add_elastic_terms(last - first + 1, self%incidence%row(first:last), self%incidence%attachment(first:last), &
                             ev%side%w(:, first:last), size(self%attached(b)%marker), ev%attached(b)%ex, self%s%rows, ev%lambda)
    end do
  end subroutine joint_accelerations

  !> Adds the frames' accelerations to every row.
  pure subroutine add_frame_terms(nb, n, row, body, frame_wrench, free, rows, lambda)
    integer, intent(in) :: nb, n, rows
    integer, intent(in) :: row(n), body(n)
    real(wp), intent(in) :: frame_wrench(3, n)   !! condensed wrenches [-, m]
    real(wp), intent(in) :: free(3, nb)           !! accelerations without joints [m/s2, rad/s2]
    real(wp), intent(inout) :: lambda(rows)         !! second derivatives of the rows so far [m/s2]
    integer :: e, b
    do e = 1, n
      b = body(e)
      lambda(row(e)) = lambda(row(e)) + (frame_wrench(1, e)*free(1, b) + frame_wrench(2, e)*free(2, b) &
                                         + frame_wrench(3, e)*free(3, b))
    end do
  end subroutine add_frame_terms

  !> Adds the free elastic accelerations of one body to the rows at its sides.
  pure subroutine add_elastic_terms(n, row, local, w, na, ex, rows, lambda)
    integer, intent(in) :: n, na, rows
    integer, intent(in) :: row(n), local(n)
    real(wp), intent(in) :: w(3, n), ex(3, na)   !! wrenches [-, m], free accelerations of the attachments [m/s2, rad/s2]
    real(wp), intent(inout) :: lambda(rows)      !! second derivatives of the rows so far [m/s2]
    integer :: e, j
    do e = 1, n
      j = local(e)
      lambda(row(e)) = lambda(row(e)) + (w(1, e)*ex(1, j) + w(2, e)*ex(2, j) + w(3, e)*ex(3, j))
    end do
  end subroutine add_elastic_terms
end module joint_system
