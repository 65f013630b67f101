!> Controllers in linear algebra, about an evaluated state (theory.md, section 14), each as if it had no limits. T(s) is that of
!> open loops. Controller c has the transfer function H_c from the sensed quantity, g_c(s).x, to its forces b_c: closing its loop
!> adds -H_c b_c g_c^T. Responses of closed loops follow by Woodbury's formula, all poles as eigenvalues of the whole system of
!> first order.
module closed_loops
  use kinds, only: wp
  use controller, only: controller_model, free
  use dynamic_stiffness, only: stiffness_system
  use evaluation_results, only: conditions_of, evaluation
  use force_element, only: stage_static
  use frame_axes, only: add_force
  use lapack, only: dgeev
  use linearisation, only: marker_jacobian, rate_jacobian
  use loads, only: load_model
  use mechanism, only: mechanism_model
  use natural_modes, only: lowest_natural_modes
  use reduced_system, only: first_order, reduced_model
  use small_matrices, only: solve_small
  use sorting, only: ascending
  implicit none (type, external)
  private

  integer, parameter, public :: most_states = 1000     !! of which all poles are computed

  !> The loops.
  type, public :: loop_system
    integer :: n = 0                                   !! controllers
    type(controller_model), allocatable :: law(:)      !! (n)
    real(wp), allocatable :: b(:, :)                   !! (unknowns, n) forces of a unit output [N, N m]
    real(wp), allocatable :: place(:, :)               !! (unknowns, n) g = place + s rate [-], [m], [1/s]
    real(wp), allocatable :: rate(:, :)                !! [-], [m]
  contains
    procedure :: build
    procedure :: close
    procedure :: opened
    procedure :: add_loops
    procedure :: poles
  end type loop_system

contains

  !> The loops about an evaluated state; none where no force follows a controller.
  subroutine build(self, m, ev, v)
    class(loop_system), intent(out) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)                       !! (nq) rates [m/s, rad/s]
    real(wp) :: by_place(6), by_rate(6)
    integer :: k
    self%n = size(m%s%controllers)
    allocate (self%law, source=m%s%controllers)
    allocate (self%b(m%s%nq, self%n), self%place(m%s%nq, self%n), self%rate(m%s%nq, self%n), source=0.0_wp)
    do k = 1, self%n
      associate (q => m%s%controllers(k)%quantity)
        call q%gradient(ev%p, by_place, by_rate)
        call add_motion(q%ia, by_place(1:3), by_rate(1:3), self%place(:, k), self%rate(:, k))
        call add_motion(q%ib, by_place(4:6), by_rate(4:6), self%place(:, k), self%rate(:, k))
      end associate
    end do
    do k = 1, size(m%s%forces)
      select type (f => m%s%forces(k)%item)
      class is (load_model)
        if (f%controller == 0 .or. f%stage == stage_static) cycle
        call add_force(m, ev, f%ia, f%unit_wrench(ev%p, conditions_of(m, ev, k)), self%b(:, f%controller))
      end select
    end do
  contains
    !> Adds a marker's position and rate as functions of the unknowns and their rates.
    subroutine add_motion(marker, by_place, by_rate, place, rate)
      integer, intent(in) :: marker
      real(wp), intent(in) :: by_place(3), by_rate(3)  !! [-], [m], [1/s]
      real(wp), intent(inout) :: place(:), rate(:)     !! (nq) [-], [m], [1/s]
      integer, allocatable :: cols(:)
      real(wp), allocatable :: jac(:, :)
      call marker_jacobian(m, ev, marker, cols, jac)
      if (size(cols) == 0) return
      place(cols) = place(cols) + matmul(by_place, jac) + matmul(by_rate, rate_jacobian(m, ev, marker, v, jac))
      rate(cols) = rate(cols) + matmul(by_rate, jac)
    end subroutine add_motion
  end subroutine build

  !> Motions by unit outputs at the s that is factored, and G: what each controller senses of them.
  subroutine find_responses(self, ds, s, g, motion)
    class(loop_system), intent(in) :: self
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(in) :: s                       !! [1/s]
    complex(wp), intent(out) :: g(:, :)                !! (n, n) [unit of each quantity]
    complex(wp), intent(out) :: motion(:, :)           !! (n + rows, n) [m, rad], [N]
    integer :: k
    do k = 1, self%n
      motion(:, k) = ds%padded(cmplx(self%b(:, k), 0.0_wp, wp))
      call ds%solve(motion(:, k))
      g(:, k) = sensed(self, s, motion(1:ds%n, k))
    end do
  end subroutine find_responses

  !> Quantities that the controllers sense in a motion.
  pure function sensed(self, s, x) result(y)
    class(loop_system), intent(in) :: self
    complex(wp), intent(in) :: s                       !! [1/s]
    complex(wp), intent(in) :: x(:)                    !! (unknowns) [m, rad]
    complex(wp) :: y(self%n)                           !! [unit of each quantity]
    integer :: k
    y = [(sum((self%place(:, k) + s*self%rate(:, k))*x), k=1, self%n)]
  end function sensed

  !> The solution of open loops at the s that is factored becomes that of closed ones: outputs u = H (y + G u).
  subroutine close(self, ds, s, x)
    class(loop_system), intent(in) :: self
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(in) :: s                       !! [1/s]
    complex(wp), intent(inout) :: x(:)                 !! (n + rows) [m, rad], [N]
    complex(wp) :: g(self%n, self%n), motion(size(x), self%n), u(self%n), h
    integer :: k
    if (self%n == 0) return
    call find_responses(self, ds, s, g, motion)
    u = sensed(self, s, x(1:ds%n))
    do k = 1, self%n
      h = self%law(k)%response(free, s)
      u(k) = h*u(k)
      g(k, :) = -h*g(k, :)
      g(k, k) = g(k, k) + 1
    end do
    call solve_small(g, u)
    x = x + matmul(motion, u)
  end subroutine close

  !> The loop of one controller opened, all others closed: -H y of a unit output, 1 + that is zero at a pole.
  complex(wp) function opened(self, ds, s, c) result(l)
    class(loop_system), intent(in) :: self
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(in) :: s                       !! [1/s]
    integer, intent(in) :: c                           !! controller
    complex(wp) :: g(self%n, self%n), motion(ds%n + ds%rows, self%n), y(self%n)
    integer :: k
    call ds%set(s, 1.0_wp)
    call ds%factor()
    call find_responses(self, ds, s, g, motion)
    y = g(:, c)
    do k = 1, self%n
      g(:, k) = -g(:, k)*merge((0.0_wp, 0.0_wp), self%law(k)%response(free, s), k == c)
      g(k, k) = g(k, k) + 1
    end do
    call solve_small(g, y)
    l = -self%law(c)%response(free, s)*y(c)
  end function opened

  !> All poles with all loops closed, or with one opened: those with Im >= 0 by ascending modulus. ok is false where the eigenvalues
  !> do not converge. The number of states is returned; above `most_states` no pole is computed.
  subroutine poles(self, ds, opened, lambda, states, ok)
    class(loop_system), intent(in) :: self
    type(stiffness_system), intent(inout), target :: ds
    integer, intent(in) :: opened                      !! controller of the loop that is opened, 0: none
    complex(wp), allocatable, intent(out) :: lambda(:) !! [1/s]
    integer, intent(out) :: states
    logical, intent(out) :: ok
    type(reduced_model) :: model
    real(wp), allocatable :: omega2(:), x(:, :), a(:, :), wr(:), wi(:), work(:)
    real(wp) :: left(1, 1), right(1, 1)
    integer :: j, c, info
    c = ds%n - ds%rows
    states = 2*c + sum(self%law%states)
    allocate (lambda(0))
    ok = .true.
    if (states == 0 .or. states > most_states) return
    call lowest_natural_modes(ds, c, .true., omega2, x, ok)
    if (.not. ok) return
    call model%build(ds, x, spread(.false., 1, c))
    call first_order(model, [(j, j=1, c)], .true., a)
    states = size(a, 1) + sum(self%law%states)
    if (states > most_states) return
    call self%add_loops(model, opened, a)
    allocate (wr(states), wi(states), work(34*states))
    call dgeev('N', 'N', states, a, states, wr, wi, left, 1, right, 1, work, size(work), info)
    ok = info == 0
    lambda = pack(cmplx(wr, wi, wp), wi >= 0.0_wp)
    lambda = lambda(ascending(abs(lambda)))
  end subroutine poles

  !> Adds all controllers to the system of first order of a model, with all loops closed or one opened.
  subroutine add_loops(self, model, opened, a)
    class(loop_system), intent(in) :: self
    type(reduced_model), intent(in) :: model
    integer, intent(in) :: opened                      !! controller of the loop that is opened, 0: none
    real(wp), allocatable, intent(inout) :: a(:, :)    !! of all motions, then with the controllers' states behind [1/s]
    real(wp), allocatable :: whole(:, :)
    integer :: k, n, states
    n = size(a, 1)
    states = n + sum(self%law%states)
    allocate (whole(states, states), source=0.0_wp)
    whole(1:n, 1:n) = a
    do k = 1, self%n
      call add_loop(self, k, merge(0.0_wp, 1.0_wp, k == opened), model, model%p, n, whole)
      n = n + self%law(k)%states
    end do
    call move_alloc(whole, a)
  end subroutine add_loops

  !> One loop in the system of first order, whose first unknowns are scale times the motions, then their rates.
  subroutine add_loop(self, k, gain, model, c, before, a)
    class(loop_system), intent(in) :: self
    integer, intent(in) :: k                           !! controller
    real(wp), intent(in) :: gain                       !! 0: its output does not act, the loop is open; else 1 [-]
    type(reduced_model), intent(in) :: model
    integer, intent(in) :: c                           !! motions
    integer, intent(in) :: before                      !! unknowns before the controller's states
    real(wp), intent(inout) :: a(:, :)                 !! [1/s]
    real(wp) :: force(c), y(size(a, 1)), yd(size(a, 1))
    integer :: i, n
    force = gain*matmul(self%b(:, k), model%basis)
    y = 0.0_wp
    yd = 0.0_wp
    y(1:c) = matmul(self%place(:, k), model%basis)/model%scale
    y(c + 1:2*c) = matmul(self%rate(:, k), model%basis)
    yd(c + 1:2*c) = matmul(self%place(:, k), model%basis)     ! asked for only where the quantity is no rate
    associate (law => self%law(k))
      n = law%states
      do i = 1, c
        a(c + i, :) = a(c + i, :) + force(i)*(law%output(n + 1, free)*y + law%output(n + 2, free)*yd)
        a(c + i, before + 1:before + n) = a(c + i, before + 1:before + n) + force(i)*law%output(1:n, free)
      end do
      do i = 1, n
        a(before + i, :) = law%rates(i, n + 1, free)*y + law%rates(i, n + 2, free)*yd
        a(before + i, before + 1:before + n) = a(before + i, before + 1:before + n) + law%rates(i, 1:n, free)
      end do
    end associate
  end subroutine add_loop
end module closed_loops
