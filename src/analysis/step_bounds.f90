!> Bounds of explicit steps from the fast end of the spectrum: eigenvalues of the fastest modes with their damping and GHM
!> terms, and the terms' own poles, put into each method's stability region (theory.md, section 8).
module step_bounds
  use kinds, only: wp
  use bound_causes, only: bound_cause, mode_cause, pole_cause, blame_damping
  use deck_records, only: deck
  use lapack, only: dgeev
  use mechanism, only: mechanism_model
  use spectrum, only: fast_spectrum, fast_mode, only_damping, only_stiffness
  use stability_region, only: largest_step, method_names
  implicit none (type, external)
  private
  public :: step_bound, find_bound, take_smaller, material_poles, look_at

  integer, parameter :: modes_looked_at = 6      !! fastest modes whose eigenvalues are computed

  !> A bound for each explicit method and what sets it.
  type :: step_bound
    real(wp) :: step(size(method_names)) = huge(1.0_wp)   !! [s]
    complex(wp) :: mu(size(method_names)) = 0.0_wp        !! the limiting eigenvalue [1/s]
    type(bound_cause) :: cause(size(method_names))        !! what it belongs to
  end type step_bound

contains

  !> Keeps the smaller bound of each method.
  pure subroutine take_smaller(other, bound)
    type(step_bound), intent(in) :: other
    type(step_bound), intent(inout) :: bound
    integer :: k
    do k = 1, size(method_names)
      if (other%step(k) >= bound%step(k)*(1 - 1.0e-9_wp)) cycle
      bound%step(k) = other%step(k)
      bound%mu(k) = other%mu(k)
      bound%cause(k) = other%cause(k)
    end do
  end subroutine take_smaller

  !> Bound at an evaluated state of a mechanism, joints held or released.
  subroutine find_bound(d, m, held, fast, bound, lambda, force)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(inout) :: m
    logical, intent(in) :: held
    type(fast_spectrum), intent(inout) :: fast !! set up
    type(step_bound), intent(out) :: bound
    real(wp), intent(out), optional :: lambda  !! largest squared frequency, instantaneous stiffness [rad2/s2]
    real(wp), intent(out), optional :: force(:)   !! (n) inertia forces of the fastest modes: a start for later iterations
    type(fast_mode) :: f
    type(bound_cause) :: cause
    real(wp) :: most
    integer :: k
    call fast%largest(m, held, only_stiffness, 100, most)
    if (present(lambda)) lambda = most
    if (present(force)) then
      force = 0.0_wp
      do k = 1, min(4, fast%steps)
        force = force + matmul(fast%w(:, 1:fast%steps), fast%t(1:fast%steps, fast%steps + 1 - k))
      end do
    end if
    do k = 1, min(modes_looked_at, fast%steps)
      if (fast%e(fast%steps + 1 - k) < 0.25_wp*most) exit
      call fast%mode(m, k, f)
      call mode_cause(m, f, cause)
      call look_at(d, m, fast, f, cause, bound)
    end do
    if (any(m%s%springs%damping > 0.0_wp) .or. any(m%s%bodies%rayleigh)) then
      call fast%largest(m, held, only_damping, 100, most)
      do k = 1, min(2, fast%steps)
        call fast%mode(m, k, f)
        call mode_cause(m, f, cause)
      call look_at(d, m, fast, f, cause, bound)
      end do
    end if
    call material_poles(d, m, held, fast, bound)
  end subroutine find_bound

  !> Eigenvalues of one mode: roots of s2 + c s + k + sum of k_r alpha h(s).
  subroutine look_at(d, m, fast, f, carrier, bound)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(fast_spectrum), intent(in) :: fast
    type(fast_mode), intent(in) :: f
    type(bound_cause), intent(in) :: carrier   !! what the mode belongs to
    type(step_bound), intent(inout) :: bound
    complex(wp), allocatable :: roots(:)
    logical, allocatable :: is_mode(:)
    type(bound_cause) :: cause
    real(wp) :: total
    integer :: body
    total = f%stiffness + sum(f%runs)
    call modal_roots(fast, f%stiffness, f%damping, f%runs, 1.0e-6_wp*total, roots)
    cause = carrier
    if (damping_limits(fast, f, roots)) call blame_damping(f, f%springs, cause)
    call mark_mode(roots, sqrt(max(f%stiffness + extra(fast, f%runs), 0.0_wp)), is_mode)
    call take(pack(roots, is_mode), cause, bound)
    if (all(is_mode)) return
    body = cause%body
    cause = pole_cause(d, m, fast%lin%runs, maxloc(f%runs, dim=1))
    cause%body = body
    call take(pack(roots, .not. is_mode), cause, bound)
  end subroutine look_at

  !> Whether a mode would allow larger steps of rk4 without its damping.
  logical function damping_limits(fast, f, roots) result(yes)
    type(fast_spectrum), intent(in) :: fast
    type(fast_mode), intent(in) :: f
    complex(wp), intent(in) :: roots(:)        !! with damping [1/s]
    complex(wp), allocatable :: without(:)     ! [1/s]
    integer :: k
    yes = f%damping > 0.0_wp
    if (.not. yes) return
    call modal_roots(fast, f%stiffness, 0.0_wp, f%runs, 1.0e-6_wp*(f%stiffness + sum(f%runs)), without)
    yes = minval([(largest_step(1, roots(k)), k=1, size(roots))]) < &
          0.99_wp*minval([(largest_step(1, without(k)), k=1, size(without))])
  end function damping_limits

  !> Which roots are the mode's own pair: the one nearest to its frequency at instantaneous stiffness; the others are poles.
  pure subroutine mark_mode(roots, omega, is_mode)
    complex(wp), intent(in) :: roots(:)        !! [1/s]
    real(wp), intent(in) :: omega              !! [rad/s]
    logical, allocatable, intent(out) :: is_mode(:)
    real(wp) :: apart(size(roots))
    integer :: k
    k = minloc(abs(roots - cmplx(0.0_wp, omega, wp)), dim=1)
    apart = min(abs(roots - roots(k)), abs(roots - conjg(roots(k))))
    is_mode = apart <= 1.0e-9_wp*abs(roots(k)) .or. size(roots) == 2
  end subroutine mark_mode

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
  subroutine take(roots, cause, bound)
    complex(wp), intent(in) :: roots(:)        !! [1/s]
    type(bound_cause), intent(in) :: cause     !! what they belong to
    type(step_bound), intent(inout) :: bound
    real(wp) :: h
    integer :: k, i
    do k = 1, size(method_names)
      do i = 1, size(roots)
        h = largest_step(k, roots(i))
        if (h >= bound%step(k)*(1 - 1.0e-9_wp)) cycle
        bound%step(k) = h
        bound%mu(k) = roots(i)
        bound%cause(k) = cause
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
      if (.not. runs(r) > small) cycle
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

  !> Poles of every material's and spring's terms, between two ends: where hardly anything moves (the terms' own poles, which
  !> slow modes approach), and where the least mass resists, in the motion that the material or spring alone would make
  !> fastest. Poles of real modes lie between.
  subroutine material_poles(d, m, held, fast, bound)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(inout) :: m
    logical, intent(in) :: held
    type(fast_spectrum), intent(inout) :: fast
    type(step_bound), intent(inout) :: bound
    complex(wp), allocatable :: roots(:)
    logical, allocatable :: is_mode(:)
    real(wp) :: share(size(fast%lin%runs)), lambda
    integer :: r
    do r = 1, size(fast%lin%runs)
      if (repeated(r)) cycle
      associate (t => fast%lin%runs(r))
        call term_roots(t%zeta, t%omega, roots)
        call take(roots, pole_cause(d, m, fast%lin%runs, r), bound)
        call fast%largest_of_run(m, held, r, lambda)
        if (.not. lambda > 0.0_wp) cycle
        share = 0.0_wp
        share(r) = lambda
        call modal_roots(fast, lambda, 0.0_wp, share, 0.0_wp, roots)
        call mark_mode(roots, sqrt(lambda*(1 + sum(t%alpha))), is_mode)
        call take(pack(roots, .not. is_mode), pole_cause(d, m, fast%lin%runs, r), bound)
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

  !> The terms' own poles, roots of s2 + 2 zeta omega s + omega2: those of z where x is held.
  pure subroutine term_roots(zeta, omega, roots)
    real(wp), intent(in) :: zeta(:)            !! [-]
    real(wp), intent(in) :: omega(:)           !! [rad/s]
    complex(wp), allocatable, intent(out) :: roots(:)
    complex(wp) :: w(size(zeta))
    w = sqrt(cmplx(zeta**2 - 1, 0.0_wp, wp))
    roots = [omega*(w - zeta), omega*(-w - zeta)]
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
end module step_bounds
