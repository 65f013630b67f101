!> Axial forces of bodies with linear strain, over the load that buckles them on their joints (theory.md, section 9): how much of
!> their bending stiffness pressure takes or tension gives, which linear strain leaves out.
module axial_loads
  use kinds, only: half_digits, wp, pi
  use beam_element, only: geometric_stiffness
  use body, only: body_model
  use body_tangents, only: find_wrenches, frame_acceleration
  use element_law, only: forces_of
  use evaluation_results, only: evaluation
  use held_body, only: held_body_model, held_modes, hold_bodies
  use lapack, only: dsyev
  use linearisation, only: joint_rows_matrix
  use mechanism, only: mechanism_model
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: axial_force_of, begin_axial, note_axial, critical_shares

  integer, parameter, public :: pressed = 1, pulled = 2
  integer, parameter :: mean = 3

  real(wp), parameter :: far_below = 1.0e-3_wp       !! Euler's load of a beam free at one end: no critical load is needed [-]

  !> Axial forces of all elements where one was lowest, where one was highest, and now. They are means over the time of a vibration
  !> in bending, 1/omega: what is faster, as waves along the beam are, leaves bending as it is.
  type, public :: axial_watch
    real(wp), allocatable :: worst(:, :)             !! (elements of all bodies, 3), part of a checkpoint [N]
    real(wp) :: latest = 0.0_wp                      !! time of the last state, likewise [s]
    integer, allocatable :: before(:)                !! (nb) elements of the bodies before
    logical, allocatable :: straight(:)              !! (nb) whether the elements of a body follow each other in one direction
    real(wp), allocatable :: wrench(:, :)            !! (3, markers) of the present state [N, N m]
    real(wp), allocatable :: now(:)                  !! (elements of the largest body) axial forces of the present state [N]
    real(wp), allocatable :: at(:)                   !! (nodes of the largest body) forces there less those that move masses [N]
  end type axial_watch

contains

  !> Starts the watch.
  subroutine begin_axial(self, m)
    type(axial_watch), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: b, n
    if (allocated(self%worst)) deallocate (self%worst, self%before, self%straight, self%wrench, self%now, self%at)
    allocate (self%before(size(m%s%bodies)), source=0)
    allocate (self%straight(size(m%s%bodies)), source=.false.)
    allocate (self%wrench(3, size(m%s%markers)), self%now(maxval([0, m%s%bodies%ne])), self%at(maxval([0, m%s%bodies%nn])))
    n = 0
    do b = 1, size(m%s%bodies)
      self%before(b) = n
      if (.not. watched(m%s%bodies(b))) cycle
      n = n + m%s%bodies(b)%ne
      self%straight(b) = in_line(m%s%bodies(b))
    end do
    allocate (self%worst(n, 3), source=0.0_wp)
    self%latest = 0.0_wp
  end subroutine begin_axial

  !> Whether linear strain leaves something out.
  pure logical function watched(b)
    type(body_model), intent(in) :: b
    watched = b%flexible .and. .not. b%stiffening
  end function watched

  !> Adds an evaluated state.
  subroutine note_axial(self, m, ev, v)
    type(axial_watch), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)                     !! (nq) [m/s, rad/s]
    real(wp) :: part                                 ! [-]
    integer :: b
    if (size(self%worst) == 0) return
    call find_wrenches(m, ev, ev%lambda, ev%action, self%wrench)
    do b = 1, size(m%s%bodies)
      if (.not. watched(m%s%bodies(b))) cycle
      associate (ne => m%s%bodies(b)%ne, first => self%before(b))
        call axial_forces(m, ev, b, v, self%straight(b), self%wrench, self%at, self%now(:ne))
        part = part_of(m%s%bodies(b), ev%t - self%latest)
        associate (n => self%now(:ne), worst => self%worst(first + 1:first + ne, :))
          n = worst(:, mean) + part*(n - worst(:, mean))
          worst(:, mean) = n
          if (minval(n) < minval(worst(:, pressed))) worst(:, pressed) = n
          if (maxval(n) > maxval(worst(:, pulled))) worst(:, pulled) = n
        end associate
      end associate
    end do
    self%latest = ev%t
  end subroutine note_axial

  !> The present axial force of an element of a body that is watched.
  pure real(wp) function axial_force_of(self, b, e) result(n)   ! [N]
    type(axial_watch), intent(in) :: self
    integer, intent(in) :: b, e                      !! body, element
    n = self%worst(self%before(b) + e, mean)
  end function axial_force_of

  !> What a state after some time counts in the mean; all of the first one, and of an equilibrium.
  pure real(wp) function part_of(b, time) result(part)   ! [-]
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: time                     !! [s]
    part = 1.0_wp
    if (time > 0.0_wp) part = 1 - exp(-time*pi**2*sqrt(least_bending(b)/(b%mass*sum(b%elements%length)**3)))
  end function part_of

  !> The least bending stiffness of an element.
  pure real(wp) function least_bending(b) result(ei)   ! [N m2]
    type(body_model), intent(in) :: b
    ei = minval(b%elements%ei_l*b%elements%length)
  end function least_bending

  !> Axial force of each element: of a beam in line what balances the forces and the inertia before it, of frames by their strain.
  subroutine axial_forces(m, ev, b, v, straight, wrench, at, n)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: b                         !! body
    real(wp), intent(in) :: v(:)                     !! (nq) [m/s, rad/s]
    logical, intent(in) :: straight                  !! whether its elements follow each other in one direction
    real(wp), intent(in) :: wrench(:, :)             !! (3, markers) of `find_wrenches` [N, N m]
    real(wp), intent(out) :: at(:)                   !! (nodes at least) forces there less those that move masses [N]
    real(wp), intent(out) :: n(:)                    !! (elements) [N]
    real(wp) :: along(2), a(2), spin, turning        ! [-], [m/s2], [rad/s], [rad/s2]
    real(wp) :: middle(2), half                      ! of an element [m], the force that moves half of it [N]
    integer :: k, e
    associate (body => m%s%bodies(b), i => m%s%qo(b))
      if (.not. straight) then
        n = 0.0_wp
        if (body%basis%reduced_from > 0) return
        do e = 1, body%ne
          n(e) = sum([1.0_wp, 0.0_wp, 0.0_wp]*real(forces_of(body, e, cmplx(body%basis%element_strain(body, e, ev%elastic(b)), &
                                                                                     kind=wp)), wp))
        end do
        return
      end if
      along = [body%elements(1)%c, body%elements(1)%s]
      a = frame_acceleration(m, ev, b, ev%a)
      spin = v(i + 3)
      turning = ev%a(i + 3)
      at = 0.0_wp
      do k = 1, size(m%s%markers)
        if (m%s%markers(k)%body == b) at(max(1, m%s%markers(k)%node)) = at(max(1, m%s%markers(k)%node)) &
                                                                        - dot_product(along, wrench(1:2, k))
      end do
      do k = 1, size(body%lumps)
        at(body%lumps(k)%node) = at(body%lumps(k)%node) - body%lumps(k)%mass*moved(body%lumps(k)%x)
      end do
      n(1) = -at(1)
      do e = 1, body%ne
        middle = 0.5_wp*[body%x(1, e) + body%x(1, e + 1), body%x(2, e) + body%x(2, e + 1)]
        half = 0.5_wp*body%elements(e)%mass*moved(middle)
        n(e) = n(e) + half
        if (e < body%ne) n(e + 1) = n(e) + half - at(e + 1)
      end do
    end associate
  contains
    !> Acceleration of a point along the beam, which it has as part of the rigid frame.
    pure real(wp) function moved(x)                  ! [m/s2]
      real(wp), intent(in) :: x(2)                   !! [m]
      moved = dot_product(along, a + turning*[-x(2), x(1)] - spin**2*x)
    end function moved
  end subroutine axial_forces

  !> Whether elements follow each other in one direction.
  pure logical function in_line(b)
    type(body_model), intent(in) :: b
    integer :: e
    in_line = all(b%en(1, :) == [(e, e=1, b%ne)]) .and. all(b%en(2, :) == [(e + 1, e=1, b%ne)]) .and. &
              all(hypot(b%elements%c - b%elements(1)%c, b%elements%s - b%elements(1)%s) <= half_digits)
  end function in_line

  !> The share of a body's bending stiffness that the largest pressure took, and that tension would have given: 1 is the critical
  !> load. Joint rows are those of the last evaluation.
  function critical_shares(self, m, ev, b) result(share)      ! [-]
    type(axial_watch), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: b                         !! body
    real(wp) :: share(2)
    type(held_body_model), allocatable :: held(:)
    type(triplet_matrix) :: joints
    real(wp), allocatable :: omega2(:), x(:, :), a(:, :, :), lambda(:), work(:)
    real(wp) :: u(6, m%s%bodies(b)%nf + 3)
    integer :: e, k, info
    logical :: ok
    share = 0.0_wp
    if (.not. watched(m%s%bodies(b))) return
    associate (body => m%s%bodies(b), worst => self%worst(self%before(b) + 1:self%before(b) + m%s%bodies(b)%ne, :2))
      if (maxval(abs(worst)) <= far_below*pi**2/4*least_bending(body)/sum(body%elements%length)**2) return
      call joint_rows_matrix(m, ev, joints)
      call hold_bodies(m, [b], joints, held, ok)
      if (.not. ok) return
      call held_modes(held, omega2, x)
      if (size(omega2) == 0) return
      do k = 1, size(omega2)
        x(:, k) = x(:, k)/sqrt(omega2(k))
      end do
      allocate (a(size(omega2), size(omega2), 2), lambda(size(omega2)), work(40*size(omega2)))
      a = 0.0_wp
      do e = 1, body%ne
        u(:, :size(omega2)) = motion_of(e)
        a(:, :, pressed) = a(:, :, pressed) + product_of(e, worst(e, pressed))
        a(:, :, pulled) = a(:, :, pulled) + product_of(e, worst(e, pulled))
      end do
      do k = 1, 2
        call dsyev('N', 'U', size(lambda), a(:, :, k), size(lambda), lambda, work, size(work), info)
        if (info /= 0) return
        share(k) = max(0.0_wp, merge(-lambda(1), lambda(size(lambda)), k == pressed))
      end do
    end associate
  contains
    !> Coordinates of an element's ends in the modes, the frame's motion included.
    pure function motion_of(e) result(u)             ! [m, rad, over J^.5]
      integer, intent(in) :: e
      real(wp) :: u(6, size(omega2))
      real(wp) :: whole(size(held(1)%b%edof, 1))     ! [m, rad, over J^.5]
      integer :: k, j
      do k = 1, size(omega2)
        whole = held(1)%b%basis%element_coordinates(held(1)%b, e, x(4:, k))
        u(:, k) = whole(:6)
        do j = 1, 2
          associate (at => held(1)%b%x(:, held(1)%b%en(j, e)))
            u(3*j - 2:3*j, k) = u(3*j - 2:3*j, k) + [x(1, k) - x(3, k)*at(2), x(2, k) + x(3, k)*at(1), x(3, k)]
          end associate
        end do
      end do
    end function motion_of

    !> U^T K U of the geometric stiffness by an axial force.
    pure function product_of(e, n) result(k)         ! [-]
      integer, intent(in) :: e
      real(wp), intent(in) :: n                      !! [N]
      real(wp) :: k(size(omega2), size(omega2))
      associate (of => u(:, :size(omega2)))
        k = matmul(transpose(of), matmul(geometric_stiffness(held(1)%b%elements(e), n), of))
      end associate
    end function product_of
  end function critical_shares
end module axial_loads
