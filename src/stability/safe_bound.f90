!> Bound of explicit steps that holds for every direction that springs take in a run, joints released (theory.md, section 8).
!>
!> Without damping the largest frequency sets it. With damping, every eigenvalue mu with its vector x, mass-normalised, obeys
!>   mu2 + c mu + k = 0,   c = x* C x,  k = x* K x,
!> for C and K symmetric; and for all x, p c + q k <= largest eigenvalue of p C + q K, whatever p and q. Straight lines in the
!> plane of c and k thus enclose all eigenvalues, those of damped modes that no undamped one resembles, too. Springs that may turn
!> count where they raise p C + q K.
!>
!> Springs turn with the bodies that they join. A bound that holds wherever bodies come to in a run must not depend on the
!> direction in which a spring pulls, seen from either body: with u_a and u_b the displacements of its ends,
!>
!>   (e_a.u_a - e_b.u_b)^2 <= (1 + s) |u_a|^2 + (1 + 1/s) |u_b|^2   for all unit vectors e_a, e_b and every s > 0,
!>
!> so that its stiffness k is at most that of two springs that act in all directions, (1 + s) k from a and
!> (1 + 1/s) k from b to the ground. With s = rho_b/rho_a, the ratio of the ends' accelerations by a unit force (largest
!> eigenvalues of J M^-1 J^T), this is exact for one spring between two bodies: k (rho_a + rho_b). Its tension F adds
!> F/length <= k across it, which is covered, too, and |F| |lever| against turns of a body about its mass centre.
module safe_bound
  use kinds, only: wp, half_digits, pi
  use evaluation_results, only: evaluation
  use mass_solve, only: solve_body
  use measure, only: measured
  use mechanism, only: mechanism_model
  use modal_eigenvalues, only: added_stiffness
  use spectrum, only: fast_spectrum, fast_mode, only_damping, only_stiffness
  use step_bounds, only: bound_cause, mode_cause, step_bound, find_bound, take_smaller, material_poles, add_mode_bound
  implicit none (type, external)
  private
  public :: find_safe_bound, turning_stiffness

  real(wp), parameter :: parallel = half_digits   !! sine of the angle between a guide and a spring along it [-]
  integer, parameter :: powers = 3                 !! lines stand at slopes of 4**-powers to 4**powers between the axes
  integer, parameter :: lines = 3*(2*powers + 2)  !! that enclose c and k, counted from k >= 0 on; the last one: c >= 0
  integer, parameter :: points = 8                 !! of the stretch of a line between its corners

  !> A line c cos(angle)/c0 + k sin(angle)/k0 = distance, and the bound from its stretch between its neighbours.
  type :: enclosing_line
    real(wp) :: angle = 0.0_wp                     !! [rad]
    real(wp) :: distance = 0.0_wp                  !! [-]
    logical :: exists = .false.                    !! a line of some mode, rather than c >= 0 or k >= 0
    type(fast_mode) :: mode                        !! the mode whose c and k are on it
    real(wp) :: touches(2) = 0.0_wp                !! its c and k, in units of the largest [-]
    type(bound_cause) :: cause                     !! the body that carries this mode
  end type enclosing_line

  !> The lines by their angles, in units of the largest c and k.
  type :: enclosure
    real(wp) :: c0 = 0.0_wp                        !! [1/s]
    real(wp) :: k0 = 0.0_wp                        !! [1/s2]
    type(enclosing_line) :: line(0:lines)
  end type enclosure

contains

  !> The safe bound: the smaller one of two, with and without springs that have viscoelastic terms. Such a spring may turn away
  !> from a mode that its terms damp.
  subroutine find_safe_bound(m, ev, fast, bound)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(fast_spectrum), intent(inout) :: fast     !! set up
    type(step_bound), intent(out) :: bound
    type(step_bound) :: other
    logical :: damped(size(m%s%forces))
    integer :: k
    fast%turning = turning_stiffness(m, ev)
    call bound_directions(m, ev, fast%ends)
    call bound_of_directions(m, ev, fast, bound)
    damped = [(m%s%forces(k)%item%law%order() > 0 .and. all(fast%ends(:, k) >= 0.0_wp), k=1, size(damped))]
    if (any(damped)) then
      do k = 1, size(damped)
        if (damped(k)) fast%ends(:, k) = 0.0_wp
      end do
      call bound_of_directions(m, ev, fast, other)
      call take_smaller(other, bound)
    end if
    fast%ends = -1.0_wp
    fast%turning = 0.0_wp
  end subroutine find_safe_bound

  !> The bound of the directions that fast%ends and fast%turning allow.
  subroutine bound_of_directions(m, ev, fast, bound)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(fast_spectrum), intent(inout) :: fast
    type(step_bound), intent(out) :: bound
    type(enclosure) :: e
    integer :: i, k
    if (.not. fast%damped) then
      call find_bound(m, ev, .false., fast, bound)
      return
    end if
    call fast%largest(m, ev, .false., only_damping, 100, e%c0)
    call fast%largest(m, ev, .false., only_stiffness, 100, e%k0)
    if (.not. e%k0 > 0.0_wp) e%k0 = e%c0**2
    if (.not. e%c0 > 0.0_wp) e%c0 = sqrt(e%k0)
    if (.not. e%c0 > 0.0_wp) return
    do i = 0, lines
      k = mod(i, 2*powers + 2)
      e%line(i)%angle = 0.5_wp*pi*(i/(2*powers + 2) - 1)
      if (k > 0) e%line(i)%angle = e%line(i)%angle + atan(4.0_wp**(k - powers - 1))
      if (i > 0 .and. i < lines) call find_line(m, ev, fast, e, e%line(i))
    end do
    do i = 1, lines - 1
      call find_steps(m, fast, e, i, bound)
    end do
    call material_poles(m, ev, .false., fast, e%k0, bound)
  end subroutine bound_of_directions

  !> The distance of a line: the largest eigenvalue in its direction, with the remaining error of the iteration.
  subroutine find_line(m, ev, fast, e, l)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(fast_spectrum), intent(inout) :: fast
    type(enclosure), intent(in) :: e
    type(enclosing_line), intent(inout) :: l
    call fast%largest(m, ev, .false., [cos(l%angle)/e%c0, sin(l%angle)/e%k0], 100, l%distance)
    l%distance = l%distance + fast%beta(fast%steps)*abs(fast%t(fast%steps, fast%steps))
    call fast%mode(m, ev, 1, l%mode)
    call mode_cause(m, l%mode, l%cause)
    l%touches = [l%mode%damping, l%mode%stiffness + added_stiffness(fast%lin%segments, l%mode%segments)]/[e%c0, e%k0]
    l%exists = .true.
  end subroutine find_line

  !> Lowers the bound by a line's stretch between its neighbours. Terms take part in k as in the mode whose c and k are nearest.
  subroutine find_steps(m, fast, e, i, bound)
    type(mechanism_model), intent(in) :: m
    type(fast_spectrum), intent(in) :: fast
    type(enclosure), intent(in) :: e
    integer, intent(in) :: i
    type(step_bound), intent(inout) :: bound
    type(fast_mode) :: f
    real(wp) :: first(2), last(2), now(2), apart(-1:1)   ! [-]
    integer :: j, k
    first = corner(e%line(i - 1), e%line(i))
    last = corner(e%line(i), e%line(i + 1))
    do j = 0, points
      now = max((first*(points - j) + last*j)/points, 0.0_wp)
      apart = [(merge(norm2(now - e%line(k)%touches), huge(1.0_wp), e%line(k)%exists), k=i - 1, i + 1)]
      associate (l => e%line(i - 2 + minloc(apart, dim=1)))
        f = l%mode
        f%stiffness = now(2)*e%k0
        f%segments = 0.0_wp
        if (l%touches(2) > 0.0_wp) then
          f%stiffness = now(2)*(l%mode%stiffness/l%touches(2))
          f%segments = now(2)*(l%mode%segments/l%touches(2))
        end if
        f%damping = now(1)*e%c0
        f%springs = f%damping
        if (l%touches(1) > 0.0_wp) f%springs = now(1)*(l%mode%springs/l%touches(1))
        call add_mode_bound(m, fast, f, l%cause, bound)
      end associate
    end do
  end subroutine find_steps

  !> Where two lines meet: c and k in units of the largest.
  pure function corner(a, b) result(x)
    type(enclosing_line), intent(in) :: a, b
    real(wp) :: x(2)                               !! [-]
    x = [a%distance*sin(b%angle) - b%distance*sin(a%angle), b%distance*cos(a%angle) - a%distance*cos(b%angle)] &
        /sin(b%angle - a%angle)
  end function corner

  !> The factors 1 + s and 1 + 1/s of every spring's ends; negative where the spring cannot turn and its present direction
  !> stays.
  subroutine bound_directions(m, ev, ends)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev    !! evaluated
    real(wp), intent(out) :: ends(:, :)          !! (2, force elements) [-]
    real(wp) :: ra, rb
    integer :: k
    ends = -1.0_wp
    do k = 1, size(m%s%forces)
      associate (sp => m%s%forces(k)%item)
        if (.not. sp%along_line) cycle
        if (is_guided(m, ev, k)) cycle
        ends(:, k) = 0.0_wp
        ra = inverse_mass(m, ev, sp%ia)
        rb = inverse_mass(m, ev, sp%ib)
        if (ra > 0.0_wp) ends(1, k) = 1 + rb/ra
        if (rb > 0.0_wp) ends(2, k) = 1 + ra/rb
      end associate
    end do
  end subroutine bound_directions

  !> Bound of the stiffness that the present forces of linear springs add against turns of every body.
  pure function turning_stiffness(m, ev) result(stiffness)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev       !! evaluated
    real(wp) :: stiffness(size(m%s%bodies))      !! [N m/rad]
    integer :: k, i, b, marker
    stiffness = 0.0_wp
    do k = 1, size(m%s%forces)
      if (.not. m%s%forces(k)%item%along_line) cycle
      do i = 1, 2
        marker = merge(m%s%forces(k)%item%ia, m%s%forces(k)%item%ib, i == 1)
        b = m%s%markers(marker)%body
        if (b == 0) cycle
        stiffness(b) = stiffness(b) + abs(ev%action(k)%force)* &
                       norm2(ev%p%rho(:, marker) - ev%frame%first_moment(:, b)/m%s%bodies(b)%mass)
      end do
    end do
  end function turning_stiffness

  !> Whether a spring's direction is fixed in both its bodies: welds, or guides along the spring, join them.
  pure logical function is_guided(m, ev, k)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                     !! spring
    type(measured) :: now
    integer :: group(0:size(m%s%bodies)), j, a, b
    logical :: welded
    group = [(j, j=0, size(m%s%bodies))]
    now = m%s%forces(k)%item%deformation(ev%p)
    do j = 1, m%s%joints
      associate (c => m%s%constraints(j)%item)
        a = group(m%s%markers(c%ia)%body)
        b = group(m%s%markers(c%ib)%body)
        welded = c%rows == 3
        associate (last => c%first + c%rows - 1)
          if (norm2(ev%rows%na(:, last)) > 0.0_wp .or. c%rows == 1) cycle   ! the sections' angle is free
        end associate
        if (welded .or. abs(dot_product(ev%rows%na(:, c%first), now%g(1:2))) <= parallel) where (group == a) group = b
      end associate
    end do
    is_guided = group(m%s%markers(m%s%forces(k)%item%ia)%body) == group(m%s%markers(m%s%forces(k)%item%ib)%body)
  end function is_guided

  !> The largest acceleration of a marker by a unit force: largest eigenvalue of J M^-1 J^T.
  real(wp) function inverse_mass(m, ev, k) result(rho)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: k                     !! marker
    real(wp), allocatable :: f(:), u(:)
    real(wp) :: c(2, 2), w(3)
    integer :: b, j
    rho = 0.0_wp
    b = m%s%markers(k)%body
    if (b == 0) return
    associate (p => m%s%markers(k), n => m%s%bodies(b)%nf)
      allocate (f(3 + n), u(3 + n))
      do j = 1, 2
        f = 0.0_wp
        w = 0.0_wp
        w(j) = 1.0_wp
        call p%add_wrench(ev%p%rho(:, k), w, f(1:3), f(4:))
        call solve_body(m, ev, b, f, u)
        w = p%displacement(ev%p%rho(:, k), u(1:3), u(4:))
        c(:, j) = w(1:2)
      end do
    end associate
    rho = 0.5_wp*(c(1, 1) + c(2, 2)) + hypot(0.5_wp*(c(1, 1) - c(2, 2)), 0.5_wp*(c(1, 2) + c(2, 1)))   ! [1/kg]
  end function inverse_mass
end module safe_bound
