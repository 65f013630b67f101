!> Mass, damping and stiffness of the whole mechanism at a trial state, in frozen axes and bordered by the joints, on one sparse
!> pattern that holds for all states, and the factor of
!>
!>   T(c1, c2) = c1 M + c2 C + K + sum_r sum_k alpha_rk (1 - g_k) K_r,   g = 1/(1 + viscosity c2 + inertia c1)
!>
!> for real or complex constants (theory.md, section 7): what the stages of an implicit Runge-Kutta method solve with. A new step
!> size refills it from the same M, C and K.
module stage_matrix
  use kinds, only: wp
  use border_rows, only: least_shift
  use body_terms, only: body_tangent
  use bordered, only: bordered_system
  use constraint, only: marker_stiffness
  use elastic_block, only: stiffening_change
  use linearisation, only: pair_block, pair_blocks, marker_jacobian, to_body
  use evaluation_results, only: evaluation, conditions_of
  use mechanism, only: mechanism_model
  use newton_equations, only: turn_wrenches, frame_acceleration
  use newton_system, only: newton_matrix
  use sparse_pattern, only: symmetric_pattern
  implicit none (type, external)
  private
  public :: set_up_stage_terms, fill_stage_terms, set_up_factor, factor_stage

  integer, parameter :: of_mass = 1, of_damping = 2, of_stiffness = 3
  real(wp), parameter :: light_shift = 1.0e-10_wp  !! of the rows' own compliance: redundant rows share their force [-]
  real(wp), parameter :: strong_shift = 1.0e-4_wp  !! the same where rows nearly depend on others, in a singular position [-]

  !> M, C and K, whose entries are noted in the same order at every state.
  type, extends(symmetric_pattern), public :: stage_terms
    integer :: nq = 0                        !! coordinates
    integer :: rows = 0                      !! constraint rows
    integer :: noted = 0                     !! contributions so far
    integer, allocatable :: at(:)            !! (contributions) entry of the pattern
    real(wp), allocatable :: value(:, :)     !! (entries, 3) M, C, K with the joints [kg, N s/m, N/m, ...]
    integer :: parts = 0                     !! contributions to what viscoelastic terms multiply so far
    integer, allocatable :: part_at(:)       !! (parts) entry of the pattern
    integer, allocatable :: part_of(:)       !! (parts) group
    real(wp), allocatable :: part(:)         !! (parts) K_r [N/m, N, N m]
    integer, allocatable :: first_group(:)   !! (nb+1) groups before those of each body's segments; then one of each force element
    real(wp) :: shift = 0.0_wp               !! of constraint rows, of their own compliance [-]
    real(wp), allocatable :: held(:)         !! (rows) compliance of each row on rigid bodies, at c1 = 1 [1/kg]
    logical :: listing = .false.             !! the pattern is being made
    integer, allocatable :: r(:), c(:)       !! while it is: rows and columns
  end type stage_terms

  !> T for one pair of constants.
  type, public :: stage_factor
    complex(wp) :: c1 = (0.0_wp, 0.0_wp)     !! [1/s2]
    complex(wp) :: c2 = (0.0_wp, 0.0_wp)     !! [1/s]
    complex(wp), allocatable :: value(:)     !! (entries) [N/m, N, N m]
    type(bordered_system) :: solver
    complex(wp), allocatable :: x(:)         !! (nq + rows) right-hand side and solution [N, m, ...]
  end type stage_factor

contains

  !> The pattern.
  subroutine set_up_stage_terms(self, newton, m, ev)
    type(stage_terms), intent(out) :: self
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), allocatable :: none(:), lambda(:)
    integer :: b, k
    self%nq = m%s%nq
    self%rows = m%s%rows
    allocate (self%first_group(size(m%s%bodies) + 1), source=0)
    do b = 1, size(m%s%bodies)
      self%first_group(b + 1) = self%first_group(b) + size(m%s%bodies(b)%segments)
    end do
    allocate (none(self%nq), lambda(self%rows), self%held(self%rows), source=0.0_wp)
    allocate (self%r(1000), self%c(1000), self%at(0), self%part_at(1000), self%part_of(1000), self%part(1000), self%value(0, 3))
    self%listing = .true.
    call fill_stage_terms(self, newton, m, ev, 0.0_wp, none, none, lambda)
    self%listing = .false.
    call self%make(self%nq + self%rows, self%r(1:self%noted), self%c(1:self%noted))
    self%at = [(self%entry(self%r(k), self%c(k)), k=1, self%noted)]
    deallocate (self%value)
    allocate (self%value(size(self%row), 3), source=0.0_wp)
    self%part_at = [(self%entry(self%part_at(k), self%part_of(k)), k=1, self%parts)]
    self%part_of = [(0, k=1, self%parts)]
    self%part = [(0.0_wp, k=1, self%parts)]
    deallocate (self%r, self%c)
  end subroutine set_up_stage_terms

  !> M, C and K at the state of the last residual of `newton`.
  subroutine fill_stage_terms(self, newton, m, ev, t, v, a, lambda)
    type(stage_terms), intent(inout) :: self
    type(newton_matrix), intent(inout) :: newton
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in) :: t                !! [s]
    real(wp), intent(in), contiguous :: v(:), a(:)   !! (nq) rates [m/s, rad/s] and accelerations
    real(wp), intent(in), contiguous :: lambda(:)    !! (rows) [N]
    integer :: b
    self%noted = 0
    self%parts = 0
    self%value = 0.0_wp
    do b = 1, size(m%s%bodies)
      call tangent(of_mass, [1.0_wp, 0.0_wp, 0.0_wp])
      call note_frame(self, newton, m, b, of_mass, 1.0_wp)
      call tangent(of_damping, [0.0_wp, 1.0_wp, 0.0_wp])
      call note_frame(self, newton, m, b, of_damping, 0.0_wp)
      call tangent(of_stiffness, [0.0_wp, 0.0_wp, 1.0_wp])
    end do
    call turn_wrenches(newton, m, ev)
    do b = 1, size(m%s%bodies)
      call note_frame(self, newton, m, b, of_stiffness, 0.0_wp)
      if (m%s%bodies(b)%flexible) call note_elastic(self, newton, m, b, v(m%s%qo(b) + 3), a(m%s%qo(b) + 3))
    end do
    call note_rows(self, m, ev)
    call note_laws(self, m, ev, t, v, lambda)
  contains
    !> One of the matrices of body b, in its work space.
    subroutine tangent(kind, x)
      integer, intent(in) :: kind
      real(wp), intent(in) :: x(3)           !! unit factors of M, C, K [-]
      integer :: i, n
      if (self%listing) return
      i = m%s%qo(b)
      n = i + 3 + newton%b(b)%eq%n
      call body_tangent(newton%b(b)%eq, m%s%bodies(b), x(of_mass), x(of_damping), x(of_stiffness), newton%q(i + 1:n), v(i + 1:n), &
                        a(i + 1:n), frame_acceleration(m, ev, b, a))
    end subroutine tangent
  end subroutine fill_stage_terms

  !> Notes a contribution to one of the matrices.
  pure subroutine note(self, row, col, kind, x)
    type(stage_terms), intent(inout) :: self
    integer, intent(in) :: row, col
    integer, intent(in) :: kind
    real(wp), intent(in) :: x                !! [kg, N s/m, N/m, ...]
    self%noted = self%noted + 1
    if (self%listing) then
      if (self%noted > size(self%r)) then
        self%r = [self%r, self%r]
        self%c = [self%c, self%c]
      end if
      self%r(self%noted) = row
      self%c(self%noted) = col
    else
      associate (e => self%at(self%noted))
        self%value(e, kind) = self%value(e, kind) + x
      end associate
    end if
  end subroutine note

  !> Notes a contribution to what the terms of a group multiply, at an entry of K.
  pure subroutine note_part(self, row, col, group, x)
    type(stage_terms), intent(inout) :: self
    integer, intent(in) :: row, col, group
    real(wp), intent(in) :: x                !! [N/m, N, N m]
    self%parts = self%parts + 1
    if (self%listing) then
      if (self%parts > size(self%part)) then
        self%part_at = [self%part_at, self%part_at]
        self%part_of = [self%part_of, self%part_of]
        self%part = [self%part, self%part]
      end if
      self%part_at(self%parts) = row
      self%part_of(self%parts) = col
    else
      self%part_of(self%parts) = group
      self%part(self%parts) = x
    end if
  end subroutine note_part

  !> The frame of a body, and what couples it and the elastic coordinates.
  subroutine note_frame(self, newton, m, b, kind, a2)
    type(stage_terms), intent(inout) :: self
    type(newton_matrix), intent(in) :: newton
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b, kind
    real(wp), intent(in) :: a2               !! 1 for the mass [-]
    integer :: i, j, k
    i = m%s%qo(b)
    associate (eq => newton%b(b)%eq, s => m%s%bodies(b)%shape%sbar)
      do j = 1, 3
        do k = 1, 3
          call note(self, i + k, i + j, kind, eq%block(k, j))
        end do
      end do
      do k = 1, eq%n
        j = i + 3 + k
        call note(self, i + 1, j, kind, eq%origin(1)*s(k, 1) - eq%origin(2)*s(k, 2))
        call note(self, i + 2, j, kind, eq%origin(1)*s(k, 2) + eq%origin(2)*s(k, 1))
        call note(self, i + 3, j, kind, eq%row(k))
        call note(self, j, i + 1, kind, a2*s(k, 1))
        call note(self, j, i + 2, kind, a2*s(k, 2))
        call note(self, j, i + 3, kind, eq%column(k))
      end do
    end associate
  end subroutine note_frame

  !> The elastic coordinates of a body (the block of theory.md, section 7).
  subroutine note_elastic(self, newton, m, b, w, wd)
    type(stage_terms), intent(inout) :: self
    type(newton_matrix), intent(in) :: newton
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp), intent(in) :: w                !! frame rate [rad/s]
    real(wp), intent(in) :: wd               !! frame acceleration [rad/s2]
    real(wp) :: k(6, 6)
    integer :: e, i, j, f
    f = m%s%qo(b) + 3
    associate (op => m%s%bodies(b)%op, body => m%s%bodies(b))
      do e = 1, size(op%m)                   ! a pattern's column is the row's number in the operators
        call note(self, f + op%even%col(e), f + op%even%row(e), of_mass, op%m(e) + op%j(e))
        call note(self, f + op%even%col(e), f + op%even%row(e), of_damping, op%c(e))
        call note(self, f + op%even%col(e), f + op%even%row(e), of_stiffness, op%k(e) - w**2*op%m(e))
      end do
      do e = 1, size(op%z)
        call note(self, f + op%odd%col(e), f + op%odd%row(e), of_damping, -2*w*op%z(e))
        call note(self, f + op%odd%col(e), f + op%odd%row(e), of_stiffness, -wd*op%z(e))
      end do
      do i = 1, size(op%entry)
        e = op%entry(i)
        call note_part(self, f + op%even%col(e), f + op%even%row(e), self%first_group(b) + op%segment(i), op%part(i))
      end do
      if (.not. body%stiffening) return
      do e = 1, body%ne
        k = 0.0_wp
        if (.not. self%listing) call stiffening_change(newton%b(b)%eq, body, e, k)
        do j = 1, 6
          do i = 1, 6
            if (body%edof(i, e) == 0 .or. body%edof(j, e) == 0) cycle
            call note(self, f + body%edof(i, e), f + body%edof(j, e), of_stiffness, k(i, j))
          end do
        end do
      end do
    end associate
  end subroutine note_elastic

  !> Phi_q and its transpose, and what a row's force moves on rigid bodies.
  subroutine note_rows(self, m, ev)
    type(stage_terms), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer, allocatable :: cols(:)
    real(wp), allocatable :: jac(:, :)
    real(wp) :: w(3), x
    integer :: i, j, side, marker
    self%shift = merge(light_shift, least_shift, m%redundant)
    self%held = 0.0_wp
    do i = 1, self%rows
      do side = 1, 2
        marker = m%incidence%row_marker(side, i)
        if (m%markers%body(marker) == 0) cycle
        call marker_jacobian(m, ev, marker, cols, jac)
        w(1:2) = to_body(m, ev, marker, merge(ev%rows%na(:, i), ev%rows%nb(:, i), side == 1))
        w(3) = merge(ev%rows%sa(i), ev%rows%sb(i), side == 1)
        do j = 1, size(cols)
          x = w(1)*jac(1, j) + w(2)*jac(2, j) + w(3)*jac(3, j)
          if (j == 3) self%held(i) = self%held(i) + x**2/m%s%bodies(m%markers%body(marker))%i11
          call note(self, self%nq + i, cols(j), of_stiffness, x)
          call note(self, cols(j), self%nq + i, of_stiffness, x)
        end do
        self%held(i) = self%held(i) + (w(1)**2 + w(2)**2)/m%s%bodies(m%markers%body(marker))%mass
      end do
    end do
  end subroutine note_rows

  !> Joints with geometric stiffness and force elements.
  subroutine note_laws(self, m, ev, t, v, lambda)
    type(stage_terms), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: t                !! [s]
    real(wp), intent(in), contiguous :: v(:) !! (nq) [m/s, rad/s]
    real(wp), intent(in), contiguous :: lambda(:)   !! (rows) [N]
    type(marker_stiffness) :: p
    integer :: k
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item)
        if (size(c%components(m%s%markers(c%ib)%body == 0)) == 0) cycle
        p%ia = c%ia
        p%ib = c%ib
        p%c = 0.0_wp
        call c%geometric(ev%p, lambda, p)
        call note_pair(self, m, ev, p, v, .false., 0)
      end associate
    end do
    do k = 1, size(m%s%forces)
      associate (f => m%s%forces(k)%item)
        if (size(f%components()) == 0) cycle
        p%ia = f%ia
        p%ib = f%ib
        p%c = 0.0_wp
        call f%tangent(ev%p, conditions_of(m, ev, k), [1.0_wp, 1.0_wp], ev%action(k)%force, p)
        call note_pair(self, m, ev, p, v, .true., 0)
        if (f%law%order() == 0) cycle
        call f%tangent(ev%p, conditions_of(m, ev, k), [1.0_wp, 0.0_wp], 0.0_wp, p)
        call note_pair(self, m, ev, p, v, .false., self%first_group(size(self%first_group)) + k)
      end associate
    end do
  end subroutine note_laws

  !> Notes the blocks of a pair of markers.
  subroutine note_pair(self, m, ev, p, v, damped, group)
    type(stage_terms), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(marker_stiffness), intent(in) :: p
    real(wp), intent(in) :: v(:)             !! (nq) [m/s, rad/s]
    logical, intent(in) :: damped
    integer, intent(in) :: group             !! of viscoelastic terms that multiply it, 0: none
    type(pair_block) :: blocks(4)
    integer :: n, i, j
    call pair_blocks(m, ev, p, v, blocks)
    do n = 1, 4
      associate (x => blocks(n))
        if (damped .and. size(x%cols) > 0) then
          x%turning(:, 1:2) = 0.0_wp         ! the origin's displacement keeps its direction
          x%k = x%k + x%turning
        end if
        do j = 1, size(x%cols)
          do i = 1, size(x%rows)
            if (group > 0) call note_part(self, x%rows(i), x%cols(j), group, x%k(i, j))
            if (group == 0) call note(self, x%rows(i), x%cols(j), of_stiffness, x%k(i, j))
            if (damped) call note(self, x%rows(i), x%cols(j), of_damping, x%c(i, j))
          end do
        end do
      end associate
    end do
  end subroutine note_pair

  !> The structure of the factors.
  subroutine set_up_factor(self, terms, m)
    type(stage_factor), intent(inout) :: self
    type(stage_terms), intent(in) :: terms
    type(mechanism_model), intent(in) :: m
    integer, allocatable :: block_of(:)
    integer :: b
    allocate (block_of(terms%nq + terms%rows), source=0)
    do b = 1, size(m%s%bodies)
      block_of(m%s%qo(b) + 4:m%s%qo(b) + 3 + m%s%bodies(b)%nf) = b
    end do
    call self%solver%set_up(terms%nq + terms%rows, terms%row, terms%col, block_of)
    allocate (self%value(size(terms%row)), self%x(terms%nq + terms%rows), source=(0.0_wp, 0.0_wp))
  end subroutine set_up_factor

  !> Fills and factors T for the constants c2 and c1 = c2**2.
  subroutine factor_stage(self, terms, newton, c2, hold)
    type(stage_factor), intent(inout) :: self
    type(stage_terms), intent(in) :: terms
    type(newton_matrix), intent(in) :: newton
    complex(wp), intent(in) :: c2            !! dv/dq [1/s]
    logical, intent(in) :: hold              !! rows that nearly depend on others are held back
    complex(wp), allocatable :: g(:)         ! (groups) what terms add to the static stiffness [-]
    integer :: k, e
    self%c2 = c2
    self%c1 = c2**2
    self%value = self%c1*terms%value(:, of_mass) + c2*terms%value(:, of_damping) + terms%value(:, of_stiffness)
    allocate (g(terms%first_group(size(terms%first_group)) + size(newton%element_factor)), source=(0.0_wp, 0.0_wp))
    do k = 1, size(newton%terms)
      associate (t => newton%terms(k))
        e = terms%first_group(size(terms%first_group)) + t%element
        if (t%body > 0) e = terms%first_group(t%body) + t%segment
        g(e) = g(e) + t%alpha*(1 - 1/(1 + t%viscosity*c2 + t%inertia*self%c1))
      end associate
    end do
    do k = 1, terms%parts
      self%value(terms%part_at(k)) = self%value(terms%part_at(k)) + g(terms%part_of(k))*terms%part(k)
    end do
    do k = 1, terms%rows
      e = terms%entry(terms%nq + k, terms%nq + k)
      self%value(e) = -merge(strong_shift, terms%shift, hold)*terms%held(k)/self%c1
    end do
    call self%solver%factor(self%value)
  end subroutine factor_stage
end module stage_matrix
