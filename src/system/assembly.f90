!> Closes the mechanism before any analysis (deck.md, "Assembly"): positions by Newton steps of least frame motion,
!> velocities with the least mass-weighted change, redundant constraints and degrees of freedom counted.
module assembly
  use kinds, only: wp
  use dynamics, only: evaluate, set_frames, place_kinematics, constraint_values, row_rates, condense_constraints, &
                      apply_multipliers
  use directions, only: require_directions
  use joint_geometry, only: condense_geometry
  use errors, only: failure, status_bad_input
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: assemble, assembly_report

  integer, parameter :: most_newton = 200
  real(wp), parameter :: closed = 1.0e-12_wp        !! |Phi| of a closed mechanism, relative to the scene's size [-]
  real(wp), parameter :: far = 0.05_wp              !! motion of a frame that is worth a warning, relative to the size [-]
  real(wp), parameter :: redundant = 1.0e-8_wp      !! pivot below which a row depends on others [-]
  real(wp), parameter :: stiff_weight = 1.0e6_wp    !! weight of stated velocities when they must be corrected [-]

  !> What assembly found.
  type :: assembly_report
    integer :: rank = 0                             !! independent constraint rows
    integer :: freedoms = 0                         !! degrees of freedom
    logical, allocatable :: dependent(:)            !! (constraints) takes part in a redundant set
    character(:), allocatable :: warnings(:)        !! one sentence each
    integer :: newton = 0                           !! position steps taken
  end type assembly_report

contains

  !> Assembled positions and velocities; dissipative coordinates are relaxed by the caller.
  subroutine assemble(self, q, v, report, fail)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(out) :: q(:), v(:)             !! (nq)
    type(assembly_report), intent(out) :: report
    type(failure), intent(inout) :: fail
    integer :: k
    allocate (character(160) :: report%warnings(0))
    q = self%s%q0
    v = self%s%v0
    call set_frames(self, q)
    call place_kinematics(self, q, v)
    do k = 1, size(self%s%constraints)
      call self%s%constraints(k)%item%begin(self%p)
    end do
    call close_positions(self, q, v, report, fail)
    if (fail%happened()) return
    do k = 1, size(self%s%constraints)
      call self%s%constraints(k)%item%settle(self%p)
    end do
    call settle_springs(self)
    call require_directions(self, tolerance(self), fail)
    if (fail%happened()) return
    call close_velocities(self, q, v, report, fail)
    if (fail%happened()) return
    call count_freedoms(self, q, v, report)
  end subroutine assemble

  !> Newton steps that move frames only, least sum of (dx2 + dy2)/S2 + dtheta2.
  subroutine close_positions(self, q, v, report, fail)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(inout) :: q(:)
    real(wp), intent(in) :: v(:)
    type(assembly_report), intent(inout) :: report
    type(failure), intent(inout) :: fail
    real(wp), allocatable :: trial(:)
    real(wp) :: worst, before, length
    integer :: pass, b, tries
    if (self%s%rows > 0) then
      self%frozen = .true.
      call frame_positions(self, q, v, worst)
      do pass = 1, most_newton
        if (worst <= tolerance(self)) exit
        do b = 1, size(self%s%bodies)
          self%low(:, b) = 0.0_wp
          self%dinv(:, b) = [self%s%size**2, self%s%size**2, 1.0_wp]
        end do
        call condense_constraints(self)
        call self%schur%factor()
        self%lambda = self%rows%phi
        call self%schur%solve(self%lambda)
        call apply_multipliers(self, self%lambda, self%a)
        trial = q
        before = worst
        length = min(1.0_wp, 0.5_wp/max(largest_motion(self, self%a), tiny(1.0_wp)))
        do tries = 1, 12
          q = trial + length*self%a
          call frame_positions(self, q, v, worst)
          if (worst <= (1 - 0.01_wp*length)*before) exit
          length = length/2
        end do
        if (tries > 12) then
          if (worst > 1.0e3_wp*tolerance(self)) exit
          if (pass > 5) exit
        end if
      end do
      report%newton = pass - 1
      self%frozen = .false.
      if (worst > tolerance(self)) then
        call fail%raise(status_bad_input, 'the mechanism cannot be assembled: '// &
                        open_joints(self, self%rows%phi, tolerance(self), 'm')// &
                        '; expected positions near which every joint and drive holds at t = 0')
        return
      end if
      call warn_of_motion(self, q, report)
    end if
    call frame_positions(self, q, v, worst)
  end subroutine close_positions

  !> |Phi| of a closed mechanism: 1e-12 of the size, but not below the rounding of positions far from the origin [m].
  pure function tolerance(self) result(gap)
    type(mechanism_model), intent(in) :: self
    real(wp) :: gap
    gap = max(closed*self%s%size, 32*epsilon(1.0_wp)*maxval(abs(self%p%r)))
  end function tolerance

  !> Largest change of a frame, relative to the size, or in radians.
  pure function largest_motion(self, dq) result(motion)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(in) :: dq(:)
    real(wp) :: motion
    integer :: b, i
    motion = 0.0_wp
    do b = 1, size(self%s%bodies)
      i = self%s%qo(b)
      motion = max(motion, hypot(dq(i + 1), dq(i + 2))/self%s%size, abs(dq(i + 3)))
    end do
  end function largest_motion

  !> Places and constraints at trial positions; the largest |Phi| [m].
  subroutine frame_positions(self, q, v, worst)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: q(:), v(:)
    real(wp), intent(out) :: worst
    call set_frames(self, q)
    call place_kinematics(self, q, v)
    call constraint_values(self, 0.0_wp)
    worst = 0.0_wp
    if (self%s%rows > 0) worst = maxval(abs(self%rows%phi))
    if (.not. worst < huge(1.0_wp)) worst = huge(1.0_wp)
  end subroutine frame_positions

  !> Names of the joints and drives whose rows do not hold, with how far they stay open.
  function open_joints(self, row, limit, unit) result(text)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(in) :: row(:)             !! (rows) Phi [m] or its rate [m/s]
    real(wp), intent(in) :: limit              !! up to which a row holds, in the same unit
    character(*), intent(in) :: unit
    character(:), allocatable :: text
    character(16) :: number
    real(wp) :: gap
    integer :: k
    text = ''
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        gap = maxval(abs(row(c%first:c%first + c%rows - 1)))
        if (gap <= limit) cycle
        write (number, '(es9.2)') gap
        if (len(text) > 0) text = text//', '
        text = text//merge('drive ', 'joint ', c%drive)//'"'//trim(c%name)//'" stays open by '//trim(adjustl(number))// &
               ' '//unit
      end associate
    end do
  end function open_joints

  !> Warns where a frame moved by more than 5 % of the size.
  subroutine warn_of_motion(self, q, report)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(in) :: q(:)
    type(assembly_report), intent(inout) :: report
    real(wp) :: dx, da
    character(16) :: text(2)
    integer :: b, i
    do b = 1, size(self%s%bodies)
      i = self%s%qo(b)
      dx = norm2(q(i + 1:i + 2) - self%s%q0(i + 1:i + 2))
      da = abs(q(i + 3) - self%s%q0(i + 3))
      if (dx <= far*self%s%size .and. da <= far) cycle
      write (text(1), '(es9.2)') dx
      write (text(2), '(es9.2)') da
      call warn(report, 'assembly moved body "'//trim(self%s%bodies(b)%name)//'" by '//trim(adjustl(text(1)))// &
                ' m and '//trim(adjustl(text(2)))//' rad: are its deck position and angle right?')
    end do
  end subroutine warn_of_motion

  !> Adds a warning.
  subroutine warn(report, text)
    type(assembly_report), intent(inout) :: report
    character(*), intent(in) :: text
    character(:), allocatable :: longer(:)
    integer :: n
    n = size(report%warnings)
    allocate (character(max(len(report%warnings), len(text))) :: longer(n + 1))
    longer(1:n) = report%warnings
    longer(n + 1) = text
    call move_alloc(longer, report%warnings)
  end subroutine warn

  !> Free lengths and angles that the deck leaves as assembled.
  subroutine settle_springs(self)
    type(mechanism_model), intent(inout) :: self
    real(wp) :: d, dd, e(2)
    integer :: k
    do k = 1, size(self%s%springs)
      if (.not. self%s%springs(k)%pending) cycle
      self%s%springs(k)%free = 0.0_wp
      call self%s%springs(k)%deformation(self%p, d, dd, e)
      self%s%springs(k)%free = d
      self%s%springs(k)%pending = .false.
    end do
  end subroutine settle_springs

  !> Velocities: stated ones kept, others follow; then stated ones corrected; elastic rates only where frames do not suffice.
  subroutine close_velocities(self, q, v, report, fail)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: q(:)
    real(wp), intent(inout) :: v(:)
    type(assembly_report), intent(inout) :: report
    type(failure), intent(inout) :: fail
    real(wp), allocatable :: none(:), start(:)
    real(wp) :: worst, goal
    integer :: attempt
    allocate (none(self%s%nz), source=0.0_wp)
    start = v
    call evaluate(self, 0.0_wp, q, v, none, none)
    if (self%s%rows == 0) return
    call row_rates(self, self%lambda)
    goal = 1.0e-11_wp*max(maxval(abs(self%p%v)), self%s%size*maxval(abs(self%p%rate)), maxval(abs(self%rows%phi_t)))
    do attempt = 1, 4
      v = start
      call evaluate(self, 0.0_wp, q, v, none, none)
      self%frozen = attempt <= 2
      call weigh_frames(self, masked=mod(attempt, 2) == 1)
      call correct_velocities(self, q, v, goal, worst)
      self%frozen = .false.
      if (worst <= goal) exit
    end do
    call evaluate(self, 0.0_wp, q, v, none, none)
    if (worst > goal) then
      call row_rates(self, self%lambda)
      call fail%raise(status_bad_input, 'no velocities satisfy the joints and drives at t = 0: '// &
                      open_joints(self, self%lambda, goal, 'm/s')//'; the mechanism is locked or a drive starts from a '// &
                      'singular position; expected a drive that begins at rest, or another start')
      return
    end if
    call warn_of_velocities(self, start, v, report)
  end subroutine close_velocities

  !> Velocity corrections with the present metric until the rows hold.
  subroutine correct_velocities(self, q, v, goal, worst)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: q(:)
    real(wp), intent(inout) :: v(:)
    real(wp), intent(in) :: goal               !! [m/s]
    real(wp), intent(out) :: worst             !! largest |Phi'| left [m/s]
    integer :: pass
    call condense_constraints(self)
    call self%schur%factor()
    do pass = 1, 6
      call place_kinematics(self, q, v)
      call row_rates(self, self%lambda)
      worst = maxval(abs(self%lambda))
      if (worst <= 0.01_wp*goal) exit
      call self%schur%solve(self%lambda)
      call apply_multipliers(self, self%lambda, self%a)
      v = v + self%a
    end do
    call place_kinematics(self, q, v)
    call row_rates(self, self%lambda)
    worst = maxval(abs(self%lambda))
  end subroutine correct_velocities

  !> Frame metrics: the rigid mass, or the mass condensed by `evaluate`; stated components fixed (masked) or heavy.
  subroutine weigh_frames(self, masked)
    type(mechanism_model), intent(inout) :: self
    logical, intent(in) :: masked
    real(wp) :: m(3, 3), p(2), weight
    integer :: b, i, k
    do b = 1, size(self%s%bodies)
      i = self%s%qo(b)
      associate (bo => self%s%bodies(b))
        if (self%frozen) then
          p = bo%i1
          m = reshape([bo%mass, 0.0_wp, -p(2), 0.0_wp, bo%mass, p(1), -p(2), p(1), bo%i11], [3, 3])
        else
          m = unfactored(self%low(:, b), self%dinv(:, b))
        end if
      end associate
      if (.not. masked) then
        do k = 1, 3
          weight = merge(sqrt(stiff_weight), 1.0_wp, self%s%stated(i + k))
          m(k, :) = m(k, :)*weight
          m(:, k) = m(:, k)*weight
        end do
        call factor_masked(m, [.false., .false., .false.], self%low(:, b), self%dinv(:, b))
      else
        call factor_masked(m, self%s%stated(i + 1:i + 3), self%low(:, b), self%dinv(:, b))
      end if
    end do
  end subroutine weigh_frames

  !> L D L^T of a 3 x 3 matrix; masked components do not move (1/D = 0).
  pure subroutine factor_masked(m, fixed, low, dinv)
    real(wp), intent(in) :: m(3, 3)
    logical, intent(in) :: fixed(3)
    real(wp), intent(out) :: low(3), dinv(3)
    real(wp) :: a(3, 3)
    integer :: k
    a = m
    do k = 1, 3
      if (.not. fixed(k)) cycle
      a(k, :) = 0.0_wp
      a(:, k) = 0.0_wp
      a(k, k) = 1.0_wp
    end do
    dinv(1) = 1.0_wp/a(1, 1)
    low(1) = a(2, 1)*dinv(1)
    low(2) = a(3, 1)*dinv(1)
    dinv(2) = 1.0_wp/(a(2, 2) - low(1)*a(2, 1))
    low(3) = (a(3, 2) - low(2)*a(2, 1))*dinv(2)
    dinv(3) = 1.0_wp/(a(3, 3) - low(2)*a(3, 1) - low(3)**2/dinv(2))
    where (fixed) dinv = 0.0_wp
  end subroutine factor_masked

  !> The matrix of an L D L^T factor.
  pure function unfactored(low, dinv) result(m)
    real(wp), intent(in) :: low(3), dinv(3)
    real(wp) :: m(3, 3), l(3, 3), ld(3, 3)
    l = reshape([1.0_wp, low(1), low(2), 0.0_wp, 1.0_wp, low(3), 0.0_wp, 0.0_wp, 1.0_wp], [3, 3])
    ld(:, 1) = l(:, 1)/dinv(1)
    ld(:, 2) = l(:, 2)/dinv(2)
    ld(:, 3) = l(:, 3)/dinv(3)
    m = matmul(ld, transpose(l))
  end function unfactored

  !> Warns of stated velocities that had to change.
  subroutine warn_of_velocities(self, start, v, report)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(in) :: start(:), v(:)
    type(assembly_report), intent(inout) :: report
    real(wp) :: change, scale
    character(16) :: text
    integer :: b, i
    scale = max(maxval(abs(self%p%v)), self%s%size*maxval(abs(self%p%rate)), tiny(1.0_wp))
    do b = 1, size(self%s%bodies)
      i = self%s%qo(b)
      change = 0.0_wp
      if (self%s%stated(i + 1)) change = norm2(v(i + 1:i + 2) - start(i + 1:i + 2))
      if (self%s%stated(i + 3)) change = max(change, self%s%size*abs(v(i + 3) - start(i + 3)))
      if (change <= 1.0e-6_wp*scale) cycle
      write (text, '(es9.2)') change
      call warn(report, 'the stated velocity of body "'//trim(self%s%bodies(b)%name)//'" contradicts the joints and was '// &
                'corrected by '//trim(adjustl(text))//' m/s')
    end do
  end subroutine warn_of_velocities

  !> Rank of the constraints, the joints of redundant sets, degrees of freedom; row weights for very uneven masses.
  subroutine count_freedoms(self, q, v, report)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: q(:), v(:)
    type(assembly_report), intent(inout) :: report
    logical, allocatable :: weak(:)
    real(wp), allocatable :: none(:), diagonal(:), x(:)
    integer :: k, i
    allocate (report%dependent(size(self%s%constraints)), source=.false.)
    report%freedoms = self%s%nq
    if (self%s%rows == 0) return
    allocate (none(self%s%nz), source=0.0_wp)
    allocate (weak(self%s%rows), x(self%s%rows))
    diagonal = self%schur%s(0, self%schur%position)
    if (maxval(diagonal) > 1.0e6_wp*minval(diagonal)) then
      where (diagonal > 0.0_wp) self%schur%scale = 1.0_wp/sqrt(diagonal)
      call evaluate(self, 0.0_wp, q, v, none, none)
    end if
    call condense_geometry(self)
    call self%schur%weak_rows(redundant, weak)
    report%rank = count(.not. weak)
    report%freedoms = self%s%nq - report%rank
    if (.not. any(weak)) return
    self%redundant = stays_redundant(self, q, v)
    if (self%redundant) self%schur%shift = 1.0e-9_wp
    call evaluate(self, 0.0_wp, q, v, none, none)
    do k = 1, self%s%rows
      if (.not. weak(k)) cycle
      call null_vector(self, k, x)
      do i = 1, size(self%s%constraints)
        associate (c => self%s%constraints(i)%item)
          if (any(abs(x(c%first:c%first + c%rows - 1)) > 1.0e-5_wp)) report%dependent(i) = .true.
        end associate
      end do
    end do
  end subroutine count_freedoms

  !> Whether rows depend on others also a little away from the start: along the velocities, or, at rest, along a motion that
  !> the constraints allow. Otherwise the start is only a singular position.
  logical function stays_redundant(self, q, v) result(yes)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: q(:), v(:)
    real(wp), allocatable :: motion(:), none(:)
    logical, allocatable :: weak(:)
    real(wp) :: reach
    integer :: k
    allocate (none(self%s%nz), source=0.0_wp)
    allocate (weak(self%s%rows))
    motion = v
    if (.not. maxval(abs(v)) > 0.0_wp) then
      motion = [(sin(1.7_wp*k) + 0.2_wp, k=1, size(q))]
      call evaluate(self, 0.0_wp, q, motion, none, none)
      call row_rates(self, self%lambda)
      call self%schur%solve(self%lambda)
      call apply_multipliers(self, self%lambda, self%a)
      motion = motion + self%a
    end if
    call evaluate(self, 0.0_wp, q, motion, none, none)
    reach = maxval(abs(self%p%v))
    yes = .true.
    if (.not. reach > 1.0e-9_wp*self%s%size) return
    motion = q + 2.0e-3_wp*self%s%size/reach*motion
    call evaluate(self, 0.0_wp, motion, v, none, none)
    call condense_geometry(self)
    call self%schur%weak_rows(redundant, weak)
    yes = any(weak)
  end function stays_redundant

  !> The part of the unit vector of a dependent row that lies in the null space of S.
  subroutine null_vector(self, k, x)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: k
    real(wp), intent(out) :: x(:)
    real(wp), allocatable :: s(:)
    integer :: i, j, pk
    allocate (s(size(x)))
    pk = self%schur%position(k)
    do i = 1, size(x)                     ! column of S for this row
      j = self%schur%position(i)
      s(i) = 0.0_wp
      if (abs(j - pk) <= self%schur%kd) s(i) = self%schur%s(abs(j - pk), min(j, pk))
      s(i) = s(i)/(self%schur%scale(i)*self%schur%scale(k))
    end do
    call self%schur%solve(s)
    x = -s
    x(k) = x(k) + 1.0_wp
  end subroutine null_vector
end module assembly
