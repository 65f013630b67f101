!> The dynamic stiffness of the linearised mechanism, T(s) = s^2 M + s C + K + sum_r g_r(s) K_r, bordered by the joints:
!>
!>   [T  J^T] [x     ]   [f]        g_r(s) = E(s)/E_R - 1 of the law of r (`viscoelastic_law`)
!>   [J   0 ] [lambda] = [d]
!>
!> so that viscoelastic terms act exactly, without internal variables (theory.md, section 5). The matrices are kept once on one
!> sparse pattern; each s costs one structured factorisation (`bordered`).
module dynamic_stiffness
  use kinds, only: wp, half_digits
  use accurate_product, only: add_accurate
  use bordered, only: bordered_system
  use linear_matrices, only: linear_mechanism, ghm_group, loop_entries, union_of_patterns, gather, make_groups, make_loops
  use mechanism, only: mechanism_model
  use sparse_pattern, only: symmetric_pattern
  implicit none (type, external)
  private
  public :: stiffness_system

  !> The system.
  type, extends(symmetric_pattern) :: stiffness_system
    integer :: n = 0                           !! mechanical unknowns
    integer :: rows = 0                        !! independent constraint rows
    integer, allocatable :: active(:)          !! (rows) their numbers among all rows
    real(wp), allocatable :: m(:)              !! (entries) mass [kg, kg m, kg m2]
    real(wp), allocatable :: c(:)              !! (entries) damping with gyroscopic terms [N s/m, N s, N m s]
    real(wp), allocatable :: k(:)              !! (entries) stiffness at E_R [N/m, N, N m]
    real(wp), allocatable :: k_low(:)          !! (entries) rounding error of k where elements were summed [as k]
    real(wp), allocatable :: gyro(:)           !! (entries) skew part of c [as c]
    real(wp), allocatable :: forces(:)         !! (n) forces that may cancel in k_ij: forces(i) forces(j) [(N/m)^1/2, (N m)^1/2]
    real(wp), allocatable :: joint(:)          !! (entries) J and J^T [-, m]
    type(ghm_group), allocatable :: groups(:)
    type(loop_entries), allocatable :: controlled(:)   !! (controllers) loops that may be closed
    complex(wp), allocatable :: inertia(:)     !! (entries) part of inertia, damping and joints in it [as k]
    complex(wp), allocatable :: values(:)      !! (entries) the bordered matrix at the present s [as k]
    complex(wp), allocatable :: slope(:)       !! (entries) its derivative [as c]
    type(bordered_system) :: solver
    logical :: symmetric = .false.             !! no gyroscopic terms, K symmetric
    logical :: conservative = .false.          !! K symmetric
    logical :: damped = .false.                !! C has a symmetric part, or there are viscoelastic terms
    integer :: factorisations = 0
    complex(wp), private :: s = (0.0_wp, 0.0_wp)        !! present s [1/s]
    real(wp), private :: damping = 0.0_wp      !! present fraction of damping [-]
    logical, private :: symmetrised = .false.  !! the symmetric part of K alone is set
  contains
    procedure :: build
    procedure :: set
    procedure :: set_real
    procedure :: close_loop
    procedure :: factor
    procedure :: modes_below
    procedure :: solve
    procedure :: padded
    procedure :: times
    procedure :: momentum
    procedure :: real_times
    procedure :: stiffness_times
    procedure :: stiffness_product
  end type stiffness_system

contains

  !> Builds the system from a linearisation; dependent constraint rows are left out.
  subroutine build(self, m, lin, largest_force, dependent)
    class(stiffness_system), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(linear_mechanism), intent(in) :: lin
    real(wp), intent(in) :: largest_force      !! that acts anywhere: frames' stiffness from forces is known to its rounding [N]
    logical, intent(in) :: dependent(:)        !! (rows) rows that follow from others
    integer, allocatable :: block_of(:), number_of(:)
    real(wp), allocatable :: loops(:)          ! (entries) part of closed loops in the damping [as c]
    real(wp) :: spring                         ! [N/m]
    integer :: b, k, nt
    self%n = lin%n
    self%active = pack([(k, k=1, lin%rows)], .not. dependent)
    self%rows = size(self%active)
    nt = self%n + self%rows
    allocate (number_of(lin%rows), source=0)
    number_of(self%active) = [(self%n + k, k=1, self%rows)]
    call union_of_patterns(self, nt, lin, number_of)
    allocate (self%m(size(self%row)), self%c(size(self%row)), self%k(size(self%row)), self%k_low(size(self%row)), &
              self%joint(size(self%row)), source=0.0_wp)
    allocate (self%inertia(size(self%row)), self%values(size(self%row)), self%slope(size(self%row)))
    call gather(self, lin%mass, self%m)
    call gather(self, lin%damping, self%c)
    call gather(self, lin%stiffness, self%k, self%k_low)
    do k = 1, lin%jacobian%count
      if (number_of(lin%jacobian%rows(k)) == 0) cycle
      b = self%entry(number_of(lin%jacobian%rows(k)), lin%jacobian%cols(k))
      self%joint(b) = self%joint(b) + lin%jacobian%values(k)
      b = self%mirror(b)
      self%joint(b) = self%joint(b) + lin%jacobian%values(k)
    end do
    call make_groups(self, lin, self%groups)
    call make_loops(self, lin, self%controlled)
    allocate (loops(size(self%row)), source=0.0_wp)
    call gather(self, lin%loops, loops)
    call classify(self, loops)
    allocate (block_of(nt), source=0)
    allocate (self%forces(self%n), source=0.0_wp)
    do b = 1, size(m%s%bodies)
      block_of(m%s%qo(b) + 4:m%s%qo(b) + 3 + m%s%bodies(b)%nf) = b
      associate (x => m%s%qo(b))                       ! springs' forces are differences of lengths: known to k times a length
        spring = max(abs(self%k(self%entry(x + 1, x + 1))), abs(self%k(self%entry(x + 2, x + 2))))
        self%forces(x + 1:x + 3) = sqrt(largest_force/m%s%size + spring)*[1.0_wp, 1.0_wp, m%s%size]
      end associate
    end do
    call self%solver%set_up(nt, self%row, self%col, block_of)
  end subroutine build

  !> Skew part of C without that of closed loops, which may damp though it is not symmetric. Whether the undamped system is
  !> symmetric, and whether there is damping at all.
  subroutine classify(self, loops)
    class(stiffness_system), intent(inout) :: self
    real(wp), intent(in) :: loops(:)                  !! (entries) [as c]
    real(wp), parameter :: unequal = 1.0e-9_wp        !! relative difference of an entry and its mirror that is no rounding [-]
    real(wp), parameter :: rounding = 1.0e-13_wp      !! relative size that counts as zero [-]
    real(wp), parameter :: cancelled = 64*epsilon(1.0_wp)   !! what sums of both diagonals' size leave of an entry that is zero [-]
    self%gyro = 0.5_wp*((self%c - loops) - (self%c(self%mirror) - loops(self%mirror)))
    where (abs(self%gyro) <= max(rounding*(abs(self%c) + abs(self%c(self%mirror))), cancelled*diagonals(self%c))) self%gyro = 0.0_wp
    self%conservative = all(abs(self%k - self%k(self%mirror)) <= max(unequal*(abs(self%k) + abs(self%k(self%mirror))), &
                                                                     cancelled*diagonals(self%k)))
    if (self%conservative) self%k = 0.5_wp*(self%k + self%k(self%mirror))
    if (self%conservative) self%k_low = 0.5_wp*(self%k_low + self%k_low(self%mirror))
    self%symmetric = self%conservative .and. all(abs(self%gyro) <= 0.0_wp)
    self%damped = size(self%groups) > 0
    if (any(abs(self%c) > 0.0_wp)) self%damped = self%damped .or. &
                                                 any(abs(self%c - self%gyro) > rounding*maxval(abs(self%c)))
  contains
    !> Of each entry the mean of its row's and its column's diagonal entry.
    pure function diagonals(a) result(size_of)
      real(wp), intent(in) :: a(:)                    !! (entries) [as a]
      real(wp) :: size_of(size(a))                    !! [as a]
      real(wp) :: diagonal(size(self%first) - 1)      ! square roots [as the root of a]
      integer :: k
      do k = 1, size(diagonal)
        diagonal(k) = sqrt(abs(a(self%entry(k, k))))
      end do
      size_of = diagonal(self%row)*diagonal(self%col)
    end function diagonals
  end subroutine classify

  !> Sets the matrix at s, with the given fraction of damping and viscoelastic terms, and its derivative.
  subroutine set(self, s, damping)
    class(stiffness_system), intent(inout) :: self
    complex(wp), intent(in) :: s               !! [1/s]
    real(wp), intent(in) :: damping            !! 1: all, 0: the undamped system [-]
    complex(wp) :: g, dg, s2
    real(wp) :: c                              ! [as self%c]
    integer :: r, k
    self%s = s
    self%damping = damping
    self%symmetrised = .false.
    s2 = s**2
    do k = 1, size(self%values)
      c = self%gyro(k) + damping*(self%c(k) - self%gyro(k))
      self%inertia(k) = cmplx(s2%re*self%m(k) + s%re*c + self%joint(k), s2%im*self%m(k) + s%im*c, wp)
      self%values(k) = self%inertia(k) + self%k(k)
      self%slope(k) = cmplx(2*s%re*self%m(k) + c, 2*s%im*self%m(k), wp)
    end do
    if (damping <= 0.0_wp) return
    do r = 1, size(self%groups)
      associate (p => self%groups(r))
        g = damping*p%law%ratio(s)
        dg = damping*p%law%slope(s)
        do k = 1, size(p%entry)
          self%values(p%entry(k)) = self%values(p%entry(k)) + g*p%value(k)
          self%slope(p%entry(k)) = self%slope(p%entry(k)) + dg*p%value(k)
        end do
      end associate
    end do
  end subroutine set

  !> Closes the loop of a controller in the matrix that was set last.
  subroutine close_loop(self, k, h)
    class(stiffness_system), intent(inout) :: self
    integer, intent(in) :: k                   !! controller
    complex(wp), intent(in) :: h               !! its output over what it senses, at the present s [any]
    associate (loop => self%controlled(k), e => self%controlled(k)%entry)
      self%inertia(e) = self%inertia(e) + h*(loop%place + self%s*loop%rate)
      self%values(e) = self%values(e) + h*(loop%place + self%s*loop%rate)
    end associate
  end subroutine close_loop

  !> Sets the symmetric part of the stiffness + shift M, with the joints.
  subroutine set_real(self, shift)
    class(stiffness_system), intent(inout) :: self
    real(wp), intent(in) :: shift              !! [1/s2]
    self%s = sqrt(cmplx(shift, 0.0_wp, wp))
    self%damping = 0.0_wp
    self%symmetrised = .not. self%conservative
    self%inertia = shift*self%m + self%joint
    self%values = self%inertia + 0.5_wp*(self%k + self%k(self%mirror))
  end subroutine set_real

  !> Factors the matrix that was set last.
  subroutine factor(self)
    class(stiffness_system), intent(inout) :: self
    call self%solver%factor(self%values)
    self%factorisations = self%factorisations + 1
  end subroutine factor

  !> How many undamped modes of a symmetric system have a squared frequency below the given one: K - sigma M bordered by J has as
  !> many negative eigenvalues, and one for each joint row (Sylvester's law of inertia). Rows get a compliance, far above rounding
  !> and far below that of what they join: without it minors vanish in which there are more rows than motions.
  integer function modes_below(self, sigma) result(below)
    class(stiffness_system), intent(inout) :: self
    real(wp), intent(in) :: sigma              !! [rad2/s2]
    real(wp), parameter :: compliance = epsilon(1.0_wp)**0.75_wp   ! over that of the stiffest unknown that the row acts on [-]
    real(wp) :: least                          ! compliance [m/N]
    integer :: e, k
    call self%set_real(-sigma)
    do k = self%n + 1, self%n + self%rows
      least = huge(1.0_wp)
      do e = self%first(k), self%first(k + 1) - 1
        if (self%row(e) > self%n) cycle
        associate (stiffness => abs(self%values(self%entry(self%row(e), self%row(e)))))
          if (abs(self%joint(e)) > 0.0_wp .and. stiffness > 0.0_wp) least = min(least, self%joint(e)**2/stiffness)
        end associate
      end do
      if (least < huge(1.0_wp)) self%values(self%entry(k, k)) = -compliance*least
    end do
    call self%solver%factor(self%values, below)
    self%factorisations = self%factorisations + 1
    below = below - self%rows
  end function modes_below

  !> Solves with the last factor and corrects by the residual; once more where that changed more than half of the digits.
  subroutine solve(self, x, exists)
    class(stiffness_system), intent(inout) :: self
    complex(wp), intent(inout) :: x(:)         !! (n+rows) right-hand side, then solution [N, N m], [m, rad]
    logical, intent(out), optional :: exists   !! false: the matrix is singular, there is no solution
    complex(wp), allocatable :: b(:), r(:)
    real(wp) :: change, last                   ! sizes of corrections [m, rad; N]
    integer :: pass
    b = x
    last = huge(1.0_wp)
    call self%solver%solve(x, .false.)
    if (present(exists)) exists = .false.
    if (.not. all(abs(x%re) + abs(x%im) < sqrt(huge(1.0_wp)))) return   ! a singular matrix: nothing to refine
    do pass = 1, 12
      r = b - balance(self, x)
      call self%solver%solve(r, .false.)
      x = x + r
      change = maxval(abs(r%re) + abs(r%im))
      if (pass >= 2 .and. .not. change < 0.5_wp*last) exit
      last = change
      if (is_part(half_digits, r(1:self%n), x(1:self%n)) .and. is_part(half_digits, r(self%n + 1:), x(self%n + 1:))) exit
    end do
    if (.not. present(exists)) return
    exists = is_part(0.1_wp, r(1:self%n), x(1:self%n))
    if (.not. exists) exists = is_part(0.1_wp, b - balance(self, x), b)
  contains
    !> Whether the largest of some numbers is at most a part of the largest of others.
    pure logical function is_part(part, some, others)
      real(wp), intent(in) :: part                             !! [-]
      complex(wp), intent(in) :: some(:), others(:)            !! [any]
      is_part = maxval(abs(some%re) + abs(some%im)) <= part*maxval(abs(others%re) + abs(others%im))
    end function is_part
  end subroutine solve

  !> The bordered matrix times x, the stiffness summed in twice the working precision.
  pure function balance(self, x) result(y)
    class(stiffness_system), intent(in) :: self
    complex(wp), intent(in) :: x(:)            !! (n+rows) [m, rad; N]
    complex(wp) :: y(size(x)), g
    integer :: r
    y = self%times(self%inertia, x)
    if (self%symmetrised) then
      call add_stiffness(self, .false., (0.5_wp, 0.0_wp), x, y)
      call add_stiffness(self, .true., (0.5_wp, 0.0_wp), x, y)
    else
      call add_stiffness(self, .false., (1.0_wp, 0.0_wp), x, y)
    end if
    if (self%damping <= 0.0_wp) return
    do r = 1, size(self%groups)
      associate (p => self%groups(r))
        g = self%damping*p%law%ratio(self%s)
        call add_accurate(self%col(p%entry), self%row(p%entry), p%value, p%rounded_off, g, x, y)
      end associate
    end do
  end function balance

  !> Adds K x, or its transpose's product, summed in twice the working precision: entries are sorted by columns.
  pure subroutine add_stiffness(self, transposed, factor, x, y)
    class(stiffness_system), intent(in) :: self
    logical, intent(in) :: transposed
    complex(wp), intent(in) :: factor          !! [-]
    complex(wp), intent(in) :: x(:)            !! (n+rows) [m, rad]
    complex(wp), intent(inout) :: y(:)         !! (n+rows) [N, N m]
    if (transposed .or. self%conservative) then
      call add_accurate(self%col, self%row, self%k, self%k_low, factor, x, y)
    else
      call add_accurate(self%col, self%row, self%k(self%mirror), self%k_low(self%mirror), factor, x, y)
    end if
  end subroutine add_stiffness

  !> A vector of mechanical unknowns with zero multipliers.
  pure function padded(self, x) result(y)
    class(stiffness_system), intent(in) :: self
    complex(wp), intent(in) :: x(:)            !! (n) [any]
    complex(wp) :: y(self%n + self%rows)       !! [as x]
    y = 0.0_wp
    y(1:self%n) = x
  end function padded

  !> A x for entries given on the pattern.
  pure function times(self, values, x) result(y)
    class(stiffness_system), intent(in) :: self
    complex(wp), intent(in) :: values(:)       !! (entries) [any]
    complex(wp), intent(in) :: x(:)            !! (n+rows) [m, rad; N]
    complex(wp) :: y(size(x))
    integer :: j, e
    y = 0.0_wp
    do j = 1, size(x)
      do e = self%first(j), self%first(j + 1) - 1
        y(self%row(e)) = y(self%row(e)) + values(e)*x(j)
      end do
    end do
  end function times

  !> M x.
  pure function momentum(self, x) result(mx)
    class(stiffness_system), intent(in) :: self
    complex(wp), intent(in) :: x(:)            !! (n) [m, rad]
    complex(wp) :: mx(size(x)), y(self%n + self%rows)   !! [kg m, kg m2]
    y = self%times(cmplx(self%m, 0.0_wp, wp), self%padded(x))
    mx = y(1:self%n)
  end function momentum

  !> A x for real entries given on the pattern, mechanical unknowns only.
  pure function real_times(self, values, x) result(y)
    class(stiffness_system), intent(in) :: self
    real(wp), intent(in) :: values(:)          !! (entries) [any]
    real(wp), intent(in) :: x(:)               !! (n) [any]
    real(wp) :: y(size(x))                     !! [unit of values times unit of x]
    integer :: j, e
    y = 0.0_wp
    do j = 1, size(x)
      do e = self%first(j), self%first(j + 1) - 1
        if (self%row(e) > size(x)) exit
        y(self%row(e)) = y(self%row(e)) + values(e)*x(j)
      end do
    end do
  end function real_times

  !> K x, or K_r x of a group, summed in twice the working precision.
  pure function stiffness_product(self, x, group) result(y)
    class(stiffness_system), intent(in) :: self
    complex(wp), intent(in) :: x(:)            !! (n+rows) [m, rad; N]
    integer, intent(in) :: group               !! 0: K at E_R
    complex(wp) :: y(size(x))
    y = 0.0_wp
    if (group == 0) then
      call add_stiffness(self, .false., (1.0_wp, 0.0_wp), x, y)
    else
      associate (p => self%groups(group))
        call add_accurate(self%col(p%entry), self%row(p%entry), p%value, p%rounded_off, (1.0_wp, 0.0_wp), x, y)
      end associate
    end if
  end function stiffness_product

  !> K x of mechanical unknowns, accurately.
  pure function stiffness_times(self, x) result(y)
    class(stiffness_system), intent(in) :: self
    real(wp), intent(in) :: x(:)               !! (n) [m, rad]
    real(wp) :: y(size(x))                     !! [N, N m]
    complex(wp) :: kz(self%n + self%rows)
    kz = self%stiffness_product(self%padded(cmplx(x, 0.0_wp, wp)), 0)
    y = real(kz(1:self%n), wp)
  end function stiffness_times
end module dynamic_stiffness
