!> Which explicit step is stable, what limits it and what removing that would buy (theory.md, section 8). Safe bound: joints
!> and drives released, for the whole run of linear bodies. Current bound: the constrained mechanism as it stands.
module step_advice
  use kinds, only: wp, pi
  use build_scene, only: build
  use deck_records, only: deck
  use dynamics, only: evaluate
  use errors, only: fault_list
  use lapack, only: dgeev
  use mechanism, only: mechanism_model, set_up_mechanism
  use nodal_kernel, only: deformations
  use scene_model, only: scene
  use spectrum, only: fast_spectrum, fast_mode
  use stability_region, only: largest_step, method_names
  implicit none (type, external)
  private
  public :: step_bound, find_bound, advise, stability_advice, stability_monitor, method_number

  integer, parameter :: modes_looked_at = 6      !! fastest modes whose eigenvalues are computed

  !> A bound for each explicit method and what sets it.
  type :: step_bound
    real(wp) :: step(size(method_names)) = huge(1.0_wp)   !! [s]
    complex(wp) :: mu(size(method_names)) = 0.0_wp        !! the limiting eigenvalue [1/s]
    character(120) :: what(size(method_names)) = ''       !! in words
    integer :: body(size(method_names)) = 0               !! body that carries the limiting mode, 0: none
    integer :: run(size(method_names)) = 0                !! GHM run whose pole limits, 0: a mode
    logical :: axial(size(method_names)) = .false.        !! the limiting mode is mainly axial
  end type step_bound

  !> Both bounds and their explanation, for the summary.
  type :: stability_advice
    type(step_bound) :: safe, current
    character(:), allocatable :: text
  end type stability_advice

  !> The current bound along a run, estimated again now and then (less than 2 % of the run's work).
  type :: stability_monitor
    logical :: active = .false.
    integer :: every = 0                       !! accepted steps between estimates
    integer :: steps = 0                       !! Lanczos steps of an estimate
    integer :: method = 0                      !! number in method_names
    integer :: estimates = 0
    real(wp) :: pole_step = huge(1.0_wp)       !! what does not depend on the configuration [s]
    real(wp) :: mode_step = huge(1.0_wp)       !! of the fastest mode at the start [s]
    real(wp) :: start_lambda = 0.0_wp          !! its squared frequency [rad2/s2]
    real(wp) :: smallest = huge(1.0_wp)        !! smallest current bound so far [s]
    real(wp) :: at = 0.0_wp                    !! when [s]
    type(fast_spectrum) :: fast
    real(wp), allocatable :: a(:), lambda(:)   !! results of the evaluation, kept over an estimate
  contains
    procedure :: begin => monitor_begin
    procedure :: look => monitor_look
  end type stability_monitor

contains

  !> Number of an explicit method, 0: not one.
  pure function method_number(method) result(k)
    character(*), intent(in) :: method
    integer :: k
    do k = size(method_names), 1, -1
      if (method_names(k) == method) return
    end do
  end function method_number

  !> Prepares the estimates along a run: the start vector joins the fastest modes of the start.
  subroutine monitor_begin(self, d, m, q, method)
    class(stability_monitor), intent(inout) :: self
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) positions at the start
    character(*), intent(in) :: method
    type(mechanism_model) :: work
    type(step_bound) :: bound
    type(fast_mode) :: f
    real(wp), allocatable :: rest(:), none(:), force(:)
    complex(wp) :: mu
    integer :: k
    self%method = method_number(method)
    if (self%method == 0 .or. m%s%rows == 0) return
    work = m
    allocate (rest(size(q)), none(m%s%nz), force(size(q)), source=0.0_wp)
    call evaluate(work, 0.0_wp, q, rest, none, none)
    call self%fast%set_up(work, q)
    call material_poles(d, work, self%fast, bound)
    self%pole_step = bound%step(self%method)
    call self%fast%largest(work, .false., .false., 100, self%start_lambda)
    if (.not. self%start_lambda > 0.0_wp) return
    do k = 1, min(4, self%fast%steps)
      call self%fast%mode(work, k, f)
      force = force + matmul(self%fast%w(:, 1:self%fast%steps), self%fast%t(1:self%fast%steps, self%fast%steps + 1 - k))
    end do
    call find_bound(d, work, .false., self%fast, bound)
    mu = bound%mu(self%method)
    self%mode_step = bound%step(self%method)
    if (bound%run(self%method) > 0) self%mode_step = huge(1.0_wp)
    self%fast%start = force + 1.0e-3_wp*norm2(force)/norm2(self%fast%start)*self%fast%start
    self%steps = min(12, size(q))
    self%a = m%a
    self%lambda = m%lambda
    self%every = ceiling((self%steps + 0.004_wp*self%steps**3)/0.08_wp)
    self%active = self%mode_step < huge(1.0_wp) .and. abs(mu) > 0.0_wp
    if (.not. self%active) self%smallest = self%pole_step
  end subroutine monitor_begin

  !> Estimates the current bound at the state of the last evaluation of m, whose results are left as they are.
  subroutine monitor_look(self, m, t)
    class(stability_monitor), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t                  !! [s]
    real(wp) :: lambda, h
    if (.not. self%active) return
    self%a(:) = m%a
    self%lambda(:) = m%lambda
    call self%fast%largest(m, .true., .false., self%steps, lambda)
    m%a(:) = self%a
    m%lambda(:) = self%lambda
    self%estimates = self%estimates + 1
    h = self%mode_step
    if (lambda > 0.0_wp) h = self%mode_step*sqrt(self%start_lambda/lambda)
    h = min(h, self%pole_step)
    if (h >= self%smallest) return
    self%smallest = h
    self%at = t
  end subroutine monitor_look

  !> Bound at an evaluated state of a mechanism, joints held or released.
  subroutine find_bound(d, m, held, fast, bound)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(inout) :: m
    logical, intent(in) :: held
    type(fast_spectrum), intent(inout) :: fast !! set up
    type(step_bound), intent(out) :: bound
    type(fast_mode) :: f
    real(wp) :: lambda
    integer :: k
    call fast%largest(m, held, .false., 100, lambda)
    do k = 1, min(modes_looked_at, fast%steps)
      if (fast%e(fast%steps + 1 - k) < 0.25_wp*lambda) exit
      call fast%mode(m, k, f)
      call look_at(d, m, fast, f, bound)
    end do
    if (any(m%s%springs%damping > 0.0_wp) .or. any(m%s%bodies%rayleigh)) then
      call fast%largest(m, held, .true., 100, lambda)
      do k = 1, min(2, fast%steps)
        call fast%mode(m, k, f)
        call look_at(d, m, fast, f, bound)
      end do
    end if
    call material_poles(d, m, fast, bound)
  end subroutine find_bound

  !> Eigenvalues of one mode: roots of s2 + c s + k + sum of k_r alpha h(s).
  subroutine look_at(d, m, fast, f, bound)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(inout) :: m
    type(fast_spectrum), intent(in) :: fast
    type(fast_mode), intent(in) :: f
    type(step_bound), intent(inout) :: bound
    complex(wp), allocatable :: roots(:)
    character(120) :: what
    real(wp), allocatable :: fast_pair(:)
    logical, allocatable :: is_mode(:)
    real(wp) :: total
    integer :: body, k
    logical :: axial
    total = f%stiffness + sum(f%runs)
    call modal_roots(fast, f%stiffness, f%damping, f%runs, 1.0e-6_wp*total, roots)
    call describe(m, f, body, axial, what)
    fast_pair = abs(roots - cmplx(0.0_wp, 1.0_wp, wp)*sqrt(max(f%stiffness + extra(fast, f%runs), 0.0_wp)))
    k = minloc(fast_pair, dim=1)
    fast_pair = min(abs(roots - roots(k)), abs(roots - conjg(roots(k))))
    is_mode = fast_pair <= 1.0e-9_wp*abs(roots(k)) .or. size(roots) == 2
    call take(pack(roots, is_mode), what, body, 0, axial, bound)
    if (all(is_mode)) return
    k = maxloc(f%runs, dim=1)
    call take(pack(roots, .not. is_mode), pole_name(d, m, fast, k), body, k, .false., bound)
  end subroutine look_at

  !> What GHM adds to a mode's stiffness at once [1/s2].
  pure function extra(fast, runs) result(k)
    type(fast_spectrum), intent(in) :: fast
    real(wp), intent(in) :: runs(:)            !! [1/s2]
    real(wp) :: k
    integer :: r
    k = 0.0_wp
    do r = 1, size(runs)
      k = k + runs(r)*sum(fast%lin%runs(r)%alpha)
    end do
  end function extra

  !> Keeps the smallest step of every method.
  subroutine take(roots, what, body, run, axial, bound)
    complex(wp), intent(in) :: roots(:)        !! [1/s]
    character(*), intent(in) :: what
    integer, intent(in) :: body, run
    logical, intent(in) :: axial
    type(step_bound), intent(inout) :: bound
    real(wp) :: h
    integer :: k, i
    do k = 1, size(method_names)
      do i = 1, size(roots)
        h = largest_step(k, roots(i))
        if (h >= bound%step(k)*(1 - 1.0e-9_wp)) cycle
        bound%step(k) = h
        bound%mu(k) = roots(i)
        bound%what(k) = what
        bound%body(k) = body
        bound%run(k) = run
        bound%axial(k) = axial
      end do
    end do
  end subroutine take

  !> Roots of (s2 + c s + k) prod d_i + sum_i a_i (s2 + 2 zeta w s) prod over the others d_j, by the eigenvalues of the
  !> equivalent first-order system (each term: z and its rate).
  subroutine modal_roots(fast, k, c, runs, small, roots)
    type(fast_spectrum), intent(in) :: fast
    real(wp), intent(in) :: k                  !! static stiffness [1/s2]
    real(wp), intent(in) :: c                  !! damping [1/s]
    real(wp), intent(in) :: runs(:)            !! stiffness of every run [1/s2]
    real(wp), intent(in) :: small              !! runs below are left out
    complex(wp), allocatable, intent(out) :: roots(:)
    real(wp), allocatable :: a(:, :)
    real(wp) :: scale
    integer :: n, r, j, i
    n = 2
    do r = 1, size(runs)
      if (runs(r) > small) n = n + 2*size(fast%lin%runs(r)%alpha)
    end do
    allocate (a(n, n), source=0.0_wp)
    scale = sqrt(max(k + sum(runs), tiny(1.0_wp)))       ! of time, so that positions and rates are alike
    a(1, 2) = scale
    a(2, 1) = -k/scale
    a(2, 2) = -c
    i = 2
    do r = 1, size(runs)
      if (runs(r) <= small) cycle
      associate (t => fast%lin%runs(r))
        do j = 1, size(t%alpha)
          a(2, 1) = a(2, 1) - t%alpha(j)*runs(r)/scale
          a(2, i + 1) = t%alpha(j)*runs(r)/scale
          a(i + 1, i + 2) = t%omega(j)
          a(i + 2, 1) = t%omega(j)
          a(i + 2, i + 1) = -t%omega(j)
          a(i + 2, i + 2) = -2*t%zeta(j)*t%omega(j)
          i = i + 2
        end do
      end associate
    end do
    call eigenvalues(a, roots)
  end subroutine modal_roots

  !> Poles of every material's and spring's terms at both ends: an element that hardly resists (the terms' own poles), and
  !> one that hardly has mass (the zeros of E(s)); those of real modes lie between.
  subroutine material_poles(d, m, fast, bound)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(fast_spectrum), intent(in) :: fast
    type(step_bound), intent(inout) :: bound
    complex(wp), allocatable :: roots(:)
    integer :: r
    do r = 1, size(fast%lin%runs)
      if (repeated(r)) cycle
      associate (t => fast%lin%runs(r))
        call term_roots(t%alpha, t%zeta, t%omega, .false., roots)
        call take(roots, pole_name(d, m, fast, r), t%body, r, .false., bound)
        call term_roots(t%alpha, t%zeta, t%omega, .true., roots)
        call take(roots, pole_name(d, m, fast, r), t%body, r, .false., bound)
      end associate
    end do
  contains
    !> Whether an earlier run has the same material.
    logical function repeated(r)
      integer, intent(in) :: r
      integer :: j
      repeated = .false.
      do j = 1, r - 1
        if (fast%lin%runs(r)%spring == 0 .and. fast%lin%runs(j)%spring == 0 .and. &
            fast%lin%runs(j)%material == fast%lin%runs(r)%material) repeated = .true.
      end do
    end function repeated
  end subroutine material_poles

  !> Roots of z'' + 2 zeta omega z' + omega^2 (z - x) = 0 for all terms, x held (0) or without mass: (1 + sum alpha) x =
  !> sum alpha z.
  subroutine term_roots(alpha, zeta, omega, massless, roots)
    real(wp), intent(in) :: alpha(:), zeta(:)  !! [-]
    real(wp), intent(in) :: omega(:)           !! [rad/s]
    logical, intent(in) :: massless
    complex(wp), allocatable, intent(out) :: roots(:)
    real(wp), allocatable :: a(:, :)
    integer :: j, k, n
    n = size(alpha)
    allocate (a(2*n, 2*n), source=0.0_wp)
    do j = 1, n
      a(2*j - 1, 2*j) = omega(j)
      a(2*j, 2*j - 1) = -omega(j)
      a(2*j, 2*j) = -2*zeta(j)*omega(j)
      if (.not. massless) cycle
      do k = 1, n
        a(2*j, 2*k - 1) = a(2*j, 2*k - 1) + omega(j)*alpha(k)/(1 + sum(alpha))
      end do
    end do
    call eigenvalues(a, roots)
  end subroutine term_roots

  !> Eigenvalues of a small dense matrix.
  subroutine eigenvalues(a, roots)
    real(wp), intent(inout) :: a(:, :)         !! destroyed
    complex(wp), allocatable, intent(out) :: roots(:)
    real(wp) :: left(1, 1), right(1, 1)
    real(wp), allocatable :: wr(:), wi(:), work(:)
    integer :: n, info
    n = size(a, 1)
    allocate (wr(n), wi(n), work(8*n))
    call dgeev('N', 'N', n, a, n, wr, wi, left, 1, right, 1, work, size(work), info)
    roots = cmplx(wr, wi, wp)
  end subroutine eigenvalues

  !> Words for the poles of a run.
  function pole_name(d, m, fast, r) result(text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(fast_spectrum), intent(in) :: fast
    integer, intent(in) :: r
    character(120) :: text
    integer :: term
    character(12) :: number
    associate (t => fast%lin%runs(r))
      term = maxloc(t%omega*(t%zeta + sqrt(max(t%zeta**2 - 1, 0.0_wp))), dim=1)
      write (number, '(i0)') term
      if (t%spring > 0) then
        text = 'GHM pole of spring "'//trim(m%s%springs(t%spring)%name)//'", term '//trim(number)
      else
        text = 'GHM pole of material "'//trim(d%materials(t%material)%name)//'", term '//trim(number)
      end if
    end associate
  end function pole_name

  !> Which body carries a mode, and whether its strain is axial or in bending.
  subroutine describe(m, f, body, axial, what)
    type(mechanism_model), intent(inout) :: m
    type(fast_mode), intent(in) :: f
    integer, intent(out) :: body
    logical, intent(out) :: axial
    character(120), intent(out) :: what
    real(wp) :: share, best, ea, ei
    logical :: stiffening
    integer :: b, i, e
    body = 0
    best = 0.0_wp
    axial = .false.
    do b = 1, size(m%s%bodies)
      i = m%s%qo(b) + 3
      associate (bo => m%s%bodies(b))
        if (.not. bo%flexible) cycle
        ea = 0.0_wp
        ei = 0.0_wp
        if (bo%modal) then
          ei = sum(bo%omega2*f%x(i + 1:i + bo%nf)**2)
        else
          bo%qx(1:bo%nf) = f%x(i + 1:i + bo%nf)
          stiffening = bo%stiffening
          bo%stiffening = .false.             ! the linear strain of the mode
          call deformations(bo, bo%qx, bo%d)
          bo%stiffening = stiffening
          do e = 1, bo%ne
            if (bo%nd == 3) ea = ea + bo%elements(e)%ea_l*bo%d(1, e)**2
            ei = ei + 4*bo%elements(e)%ei_l*(bo%d(bo%nd - 1, e)**2 + bo%d(bo%nd - 1, e)*bo%d(bo%nd, e) + bo%d(bo%nd, e)**2)
          end do
        end if
        share = ea + ei
        if (share <= best) cycle
        best = share
        body = b
        axial = ea > ei
      end associate
    end do
    if (body == 0 .or. best < 0.5_wp*(f%stiffness)) then
      what = 'a mode of springs and rigid bodies'
      if (body > 0) what = 'a mode of springs with body "'//trim(m%s%bodies(body)%name)//'"'
      body = merge(body, 0, best >= 0.5_wp*f%stiffness)
    else
      what = merge('an axial mode  ', 'a bending mode ', axial)
      what = trim(what)//' of body "'//trim(m%s%bodies(body)%name)//'"'
    end if
  end subroutine describe

  !> Both bounds at the present state, with their explanation.
  subroutine advise(d, m, q, advice)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) the assembled positions
    type(stability_advice), intent(out) :: advice
    type(mechanism_model) :: work
    type(fast_spectrum) :: fast
    real(wp), allocatable :: rest(:), none(:)
    work = m
    allocate (rest(size(q)), none(m%s%nz), source=0.0_wp)
    call evaluate(work, 0.0_wp, q, rest, none, none)
    call fast%set_up(work, q)
    call find_bound(d, work, .false., fast, advice%safe)
    call evaluate(work, 0.0_wp, q, rest, none, none)
    call find_bound(d, work, .true., fast, advice%current)
    call advice_lines(d, m, advice)
  end subroutine advise

  !> The advice in words: bounds, what limits, what removing it buys.
  subroutine advice_lines(d, m, advice)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(stability_advice), intent(inout) :: advice
    character(200) :: line
    integer :: k
    advice%text = 'stable steps of explicit methods'//new_line('a')
    do k = 1, size(method_names)
      if (advice%safe%step(k) >= huge(1.0_wp)) then
        advice%text = advice%text//'  '//trim(method_names(k))//': no limit (nothing vibrates or decays fast): accuracy '// &
                      'alone sets the step'//new_line('a')
        cycle
      end if
      write (line, '(3a, es11.4, a, es11.4, a)') '  ', trim(method_names(k)), ': safe bound ', advice%safe%step(k), &
        ' s (joints released), current bound ', advice%current%step(k), ' s (as assembled)'
      if (advice%current%step(k) > 1.0e6_wp*advice%safe%step(k)) line = line(:index(line, ', current'))// &
        ' no current bound (as assembled)'
      advice%text = advice%text//trim(line)//new_line('a')
      write (line, '(3a, es11.4, a, f6.4)') '    limited by ', trim(advice%safe%what(k)), ', |eigenvalue| ', &
        abs(advice%safe%mu(k)), ' rad/s, damping ratio ', abs(real(advice%safe%mu(k), wp))/abs(advice%safe%mu(k))
      advice%text = advice%text//trim(line)//new_line('a')
    end do
    if (any(m%s%bodies%stiffening)) advice%text = advice%text//'  note: with geometric stiffening the bounds are those '// &
                                                  'of the start; tension raises frequencies'//new_line('a')
    if (advice%safe%step(1) < huge(1.0_wp)) call what_helps(d, advice)
  end subroutine advice_lines

  !> Rebuilds the scene without what limits, and says the bound that remains.
  subroutine what_helps(d, advice)
    type(deck), intent(in) :: d
    type(stability_advice), intent(inout) :: advice
    type(deck) :: other
    character(12) :: number
    integer :: b, r
    b = advice%safe%body(1)
    if (advice%safe%run(1) > 0) then
      r = index(advice%safe%what(1), 'material "')
      if (r > 0 .and. b > 0) then
        other = d
        other%bodies(b)%viscoelastic = .false.
        call try('    without GHM in body "'//trim(d%bodies(b)%name)//'"', other, advice)
      end if
      return
    end if
    if (b == 0) return
    if (d%bodies(b)%kind == 'beam' .and. d%bodies(b)%axial .and. .not. d%bodies(b)%stiffening) then
      other = d
      other%bodies(b)%axial = .false.
      call try('    with axial=.false. on body "'//trim(d%bodies(b)%name)//'"', other, advice)
    end if
    if (d%bodies(b)%kind == 'beam' .and. d%bodies(b)%elements > 1 .and. d%bodies(b)%modes == 0) then
      other = d
      call halve_elements(other, b)
      write (number, '(i0)') other%bodies(b)%elements
      call try('    with '//trim(number)//' elements on body "'//trim(d%bodies(b)%name)//'"', other, advice)
    end if
    if (d%bodies(b)%modes == 0 .and. .not. d%bodies(b)%stiffening) then
      other = d
      other%bodies(b)%modes = 2
      call try('    with modes=2 on body "'//trim(d%bodies(b)%name)//'"', other, advice)
    end if
    other = d
    other%bodies(b)%flexible = .false.
    call try('    with body "'//trim(d%bodies(b)%name)//'" rigid', other, advice)
  end subroutine what_helps

  !> Half the elements of a beam; lumps and places keep to nodes that remain, so only ends are sure: others make it void.
  subroutine halve_elements(d, b)
    type(deck), intent(inout) :: d
    integer, intent(in) :: b
    integer :: n, k
    n = d%bodies(b)%elements
    d%bodies(b)%elements = (n + 1)/2
    d%bodies(b)%nodes = d%bodies(b)%elements + 1
    d%bodies(b)%element_material = d%bodies(b)%element_material(1:d%bodies(b)%elements)
    d%bodies(b)%element_section = d%bodies(b)%element_section(1:d%bodies(b)%elements)
    do k = 1, size(d%lumps)
      call move(d%lumps(k)%place%body, d%lumps(k)%place%node)
    end do
    do k = 1, size(d%joints)
      call move(d%joints(k)%a%body, d%joints(k)%a%node)
      call move(d%joints(k)%b%body, d%joints(k)%b%node)
    end do
    do k = 1, size(d%drives)
      call move(d%drives(k)%a%body, d%drives(k)%a%node)
      call move(d%drives(k)%b%body, d%drives(k)%b%node)
    end do
    do k = 1, size(d%springs)
      call move(d%springs(k)%a%body, d%springs(k)%a%node)
      call move(d%springs(k)%b%body, d%springs(k)%b%node)
    end do
    do k = 1, size(d%forces)
      call move(d%forces(k)%place%body, d%forces(k)%place%node)
    end do
    deallocate (d%sensors)
    allocate (d%sensors(0))
  contains
    !> The node of the coarser mesh nearest to one of the finer.
    subroutine move(body, node)
      integer, intent(in) :: body
      integer, intent(inout) :: node
      if (body /= b .or. node == 0) return
      node = 1 + nint(real((node - 1)*((n + 1)/2), wp)/n)
    end subroutine move
  end subroutine halve_elements

  !> Adds a line with the bound of a changed deck.
  subroutine try(text, other, advice)
    character(*), intent(in) :: text
    type(deck), intent(in) :: other
    type(stability_advice), intent(inout) :: advice
    type(mechanism_model) :: m
    type(scene) :: s
    type(fault_list) :: faults
    type(fast_spectrum) :: fast
    type(step_bound) :: bound
    real(wp), allocatable :: rest(:), none(:)
    character(60) :: line
    call build(other, s, faults)
    if (faults%count > 0) return
    call set_up_mechanism(m, s)
    allocate (rest(s%nq), none(s%nz), source=0.0_wp)
    call evaluate(m, 0.0_wp, s%q0, rest, none, none)
    call fast%set_up(m, s%q0)
    call find_bound(other, m, .false., fast, bound)
    if (bound%step(1) >= huge(1.0_wp)) then
      advice%text = advice%text//text//': no limit'//new_line('a')
    else
      write (line, '(a, es11.4, a, f0.2, a)') ': ', bound%step(1), ' s (rk4), ', bound%step(1)/advice%safe%step(1), ' times'
      advice%text = advice%text//text//trim(line)//new_line('a')
    end if
  end subroutine try
end module step_advice
