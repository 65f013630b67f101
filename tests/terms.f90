!> Checks each block of every body's tangent by itself against differences of the body's residual: terms DECK SEED. A random
!> state near the assembled one; for each body a line `body matrix block mismatch`, the mismatch relative to the largest entry of
!> the block. Matrices: mass, damping, stiffness (unit coefficients, frozen axes); blocks: frame, row (of the origin by the elastic
!> coordinates), angle_row, angle_column; and `whole elastic`, the elastic block of a step, factored.
program terms
  use kinds, only: wp
  use body_terms, only: body_residual, body_tangent
  use deck_reader, only: read_deck
  use errors, only: failure, fault_list
  use newton_equations, only: prepare, set_terms
  use newton_system, only: newton_matrix, set_up_newton
  use scene_run, only: run_state, prepare_run
  implicit none (type, external)
  real(wp), parameter :: c1 = 3.0e6_wp, c2 = 2.0e3_wp      !! of the step [1/s2], [1/s]
  type(run_state) :: run
  type(newton_matrix) :: t
  type(fault_list) :: faults
  type(failure) :: fail
  character(512) :: word(2)
  real(wp), allocatable :: q(:), v(:), a(:)
  integer :: b, i, n, seed
  logical :: bad
  call get_command_argument(1, word(1))
  call get_command_argument(2, word(2))
  read (word(2), *) seed
  call read_deck(trim(word(1)), run%d, faults)
  if (faults%count == 0) call prepare_run(run, faults, fail)
  if (faults%count > 0 .or. fail%happened()) error stop 2, quiet=.true.
  call set_up_newton(t, run%sys%m)
  call prepare(t, run%sys%m, c1, c2, 0.0_wp, bad)
  if (bad) error stop 3, quiet=.true.
  associate (nz => run%sys%m%s%nz)
    call set_terms(t, run%sys%m, 1.0e-3_wp*random(nz))
  end associate
  do b = 1, size(t%eq)
    i = run%sys%m%s%qo(b)
    n = 3 + t%eq(b)%n
    q = run%y(i + 1:i + n) + 0.01_wp*random(n)
    v = 30*random(n)
    a = 9000*random(n)
    call compare(1, 'mass')
    call compare(2, 'damping')
    call compare(3, 'stiffness')
    if (n > 3) call compare_whole()
  end do

contains

  !> Random numbers in (-1, 1), the same on every machine.
  function random(n) result(x)
    integer, intent(in) :: n
    real(wp) :: x(n)                         !! [-]
    integer :: i
    do i = 1, n
      seed = mod(1103*seed + 12345, 65536)
      x(i) = 2*real(seed, wp)/65536 - 1
    end do
  end function random

  !> A^T (R'' - g) [m/s2].
  function acceleration(q, a) result(x)
    real(wp), intent(in) :: q(:), a(:)       !! of the body [m, rad], [m/s2, rad/s2]
    real(wp) :: x(2), g(2)                   !! [m/s2]
    g = a(1:2) - run%sys%options%gravity
    x = [cos(q(3))*g(1) + sin(q(3))*g(2), cos(q(3))*g(2) - sin(q(3))*g(1)]
  end function acceleration

  !> The body's residual, its force on the origin in global axes.
  function residual(q, v, a) result(r)
    real(wp), intent(in) :: q(:), v(:), a(:)   !! of the body [m, rad] and per second
    real(wp) :: r(n)                           !! [N, N m]
    associate (eq => t%eq(b))
      call body_residual(eq, run%sys%m%s%bodies(b), q, v, a, acceleration(q, a))
      r(1) = cos(q(3))*eq%frame(1) - sin(q(3))*eq%frame(2)
      r(2) = sin(q(3))*eq%frame(1) + cos(q(3))*eq%frame(2)
      r(3) = eq%frame(3)
      if (n > 3) r(4:) = eq%elastic(1:n - 3)
    end associate
  end function residual

  !> Difference of the residual by unknown j of the positions, rates or accelerations, of fourth order; origins move in body axes.
  function difference(which, j) result(d)
    integer, intent(in) :: which, j            !! 1 accelerations, 2 rates, 3 positions
    real(wp) :: d(n), step(n), size_of, x(2)   !! [N, N m] per unit
    size_of = merge(1.0e-3_wp, 1.0_wp, which == 3)
    step = 0.0_wp
    step(j) = size_of
    x = step(1:2)
    step(1:2) = [cos(q(3))*x(1) - sin(q(3))*x(2), sin(q(3))*x(1) + cos(q(3))*x(2)]
    d = (8*slope(which, step) - slope(which, 2*step))/(12*size_of)
    x = d(1:2)
    d(1:2) = [cos(q(3))*x(1) + sin(q(3))*x(2), cos(q(3))*x(2) - sin(q(3))*x(1)]
  end function difference

  !> What the residual changes by from a step backwards to one forwards.
  function slope(which, step) result(d)
    integer, intent(in) :: which               !! as in `difference`
    real(wp), intent(in) :: step(:)            !! (n) [m, rad] and per second
    real(wp) :: d(n)                           !! [N, N m]
    select case (which)
    case (1)
      d = residual(q, v, a + step) - residual(q, v, a - step)
    case (2)
      d = residual(q, v + step, a) - residual(q, v - step, a)
    case default
      d = residual(q + step, v, a) - residual(q - step, v, a)
    end select
  end function slope

  !> One matrix, block by block.
  subroutine compare(which, name)
    integer, intent(in) :: which
    character(*), intent(in) :: name
    real(wp) :: d(n, n), u(3), least
    integer :: j
    do j = 1, n
      d(:, j) = difference(which, j)
    end do
    u = 0.0_wp
    u(which) = 1.0_wp
    d(:, 1) = difference(which, 1)             ! the residual's work stands at the state
    associate (eq => t%eq(b), body => run%sys%m%s%bodies(b))
      call body_tangent(eq, body, u(1), u(2), u(3), q, v, a, acceleration(q, a))
      least = 1.0e-6_wp*maxval(abs(d(1:3, 1:3)))   ! a block that is zero is compared with that of the frame
      call show(name, 'frame', maxval(abs(eq%block - d(1:3, 1:3))), maxval(abs(d(1:3, 1:3))))
      if (n == 3) return
      call show(name, 'row', max(maxval(abs(eq%origin(1)*body%shape%sbar(:, 1) - eq%origin(2)*body%shape%sbar(:, 2) - d(1, 4:))), &
                                 maxval(abs(eq%origin(1)*body%shape%sbar(:, 2) + eq%origin(2)*body%shape%sbar(:, 1) - d(2, 4:)))), &
                max(least, maxval(abs(d(1:2, 4:)))))
      call show(name, 'angle_row', maxval(abs(eq%row(1:) - d(3, 4:))), max(least, maxval(abs(d(3, 4:)))))
      call show(name, 'angle_column', maxval(abs(eq%column(1:) - d(4:, 3))), max(least, maxval(abs(d(4:, 3)))))
      call show(name, 'column', maxval(abs(u(1)*body%shape%sbar - d(4:, 1:2))), max(least, maxval(abs(body%shape%sbar))))
    end associate
  end subroutine compare

  !> The whole elastic block, by a solve of what it does to a random vector.
  subroutine compare_whole()
    real(wp) :: x(n - 3), y(n - 3), d(n)
    integer :: j
    x = random(n - 3)
    y = 0.0_wp
    do j = 4, n
      d = c1*difference(1, j) + c2*difference(2, j) + difference(3, j)
      y = y + d(4:)*x(j - 3)
    end do
    d = residual(q, v, a)
    associate (eq => t%eq(b))
      call t%t%b(b)%block%factor_full(eq, run%sys%m%s%bodies(b), c2, v(3), a(3), bad)
      if (bad) error stop 3, quiet=.true.
      call t%t%b(b)%block%solve(.true., y)
    end associate
    call show('whole', 'elastic', maxval(abs(y - x)), maxval(abs(x)))
  end subroutine compare_whole

  !> Prints one mismatch.
  subroutine show(matrix, block, error, largest)
    character(*), intent(in) :: matrix, block
    real(wp), intent(in) :: error              !! largest difference [any]
    real(wp), intent(in) :: largest            !! largest entry [any]
    write (*, '(i0, 4a, 1x, es10.3)') b, ' ', matrix, ' ', block, error/max(largest, tiny(1.0_wp))
  end subroutine show
end program terms
