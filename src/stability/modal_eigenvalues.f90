!> Eigenvalues of one mode with viscoelastic terms: roots of s2 + c s + k + sum of a_r g_r(s), and which of them are the mode's own.
module modal_eigenvalues
  use kinds, only: wp
  use lapack, only: dgeev
  use linear_matrices, only: linear_segment
  implicit none (type, external)
  private
  public :: modal_roots, mark_mode, segment_poles

  integer, parameter :: most_terms = 60          !! terms of a mode up to which all its eigenvalues are computed

contains

  !> Roots of s2 + c s + k + sum of a_r g_r(s): all of them; of very many terms the mode's own pair alone, since the poles lie
  !> between ends that `material_poles` looks at.
  subroutine modal_roots(segments, k, c, parts, small, roots)
    type(linear_segment), intent(in) :: segments(:)
    real(wp), intent(in) :: k                  !! static stiffness [1/s2]
    real(wp), intent(in) :: c                  !! damping [1/s]
    real(wp), intent(in) :: parts(:)           !! stiffness of every run [1/s2]
    real(wp), intent(in) :: small              !! runs below are left out [1/s2]
    complex(wp), allocatable, intent(out) :: roots(:)    !! [1/s]
    integer, allocatable :: kept(:)
    integer :: r
    logical :: ok
    kept = pack([(r, r=1, size(segments))], parts > small)
    ok = .false.
    if (sum([(size(segments(kept(r))%law%alpha), r=1, size(kept))]) > most_terms) then
      call mode_pair(segments(kept), k, c, parts(kept), roots, ok)
    end if
    if (.not. ok) call all_roots(segments(kept), k, c, parts(kept), roots)
  end subroutine modal_roots

  !> The two roots that the instantaneous stiffness leads to, by Newton's method.
  subroutine mode_pair(segments, k, c, parts, roots, ok)
    type(linear_segment), intent(in) :: segments(:)
    real(wp), intent(in) :: k                  !! static stiffness [1/s2]
    real(wp), intent(in) :: c                  !! damping [1/s]
    real(wp), intent(in) :: parts(:)           !! stiffness of every run [1/s2]
    complex(wp), allocatable, intent(out) :: roots(:)    !! [1/s]
    logical, intent(out) :: ok
    complex(wp) :: f, df, s, step
    integer :: i, r, pass
    allocate (roots(2))
    s = k
    do r = 1, size(segments)
      s = s + parts(r)*sum(segments(r)%law%alpha)
    end do
    s = sqrt(c**2/4 - s)
    roots = [-c/2 + s, -c/2 - s]
    do i = 1, 2
      do pass = 1, 30
        s = roots(i)
        f = s**2 + c*s + k
        df = 2*s + c
        do r = 1, size(segments)
          f = f + parts(r)*segments(r)%law%ratio(s)
          df = df + parts(r)*segments(r)%law%slope(s)
        end do
        step = f/df
        roots(i) = s - step
        ok = abs(step) <= 1.0e-13_wp*abs(s)
        if (ok) exit
      end do
      if (.not. ok) return
    end do
    ok = abs(roots(1) - roots(2)) > 1.0e-6_wp*abs(roots(1))
  end subroutine mode_pair

  !> All of them, by the eigenvalues of the equivalent first-order system (each term: z and, of second order, its rate).
  subroutine all_roots(segments, k, c, parts, roots)
    type(linear_segment), intent(in) :: segments(:)
    real(wp), intent(in) :: k                  !! static stiffness [1/s2]
    real(wp), intent(in) :: c                  !! damping [1/s]
    real(wp), intent(in) :: parts(:)           !! stiffness of every run [1/s2]
    complex(wp), allocatable, intent(out) :: roots(:)    !! [1/s]
    real(wp), allocatable :: a(:, :)
    real(wp) :: scale, omega                             ! [1/s]
    integer :: n, r, j, i
    n = 2 + sum([(segments(r)%law%order(), r=1, size(segments))])
    allocate (a(n, n), source=0.0_wp)
    scale = sqrt(max(k + sum(parts), tiny(1.0_wp)))      ! of time, so that positions and rates are alike
    a(1, 2) = scale
    a(2, 1) = -k/scale
    a(2, 2) = -c
    i = 2
    do r = 1, size(segments)
      associate (t => segments(r)%law)
        do j = 1, size(t%alpha)
          a(2, 1) = a(2, 1) - t%alpha(j)*parts(r)/scale
          a(2, i + 1) = t%alpha(j)*parts(r)/scale
          if (j <= t%second) then
            omega = 1/sqrt(t%inertia(j))
            a(i + 1, i + 2) = omega
            a(i + 2, 1) = omega
            a(i + 2, i + 1) = -omega
            a(i + 2, i + 2) = -t%viscosity(j)*omega**2
            i = i + 2
          else
            a(i + 1, 1) = 1/t%viscosity(j)
            a(i + 1, i + 1) = -1/t%viscosity(j)
            i = i + 1
          end if
        end do
      end associate
    end do
    call eigenvalues(a, roots)
  end subroutine all_roots

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

  !> Poles of a run's terms in a motion that its material or spring alone makes.
  subroutine segment_poles(segment, lambda, poles)
    type(linear_segment), intent(in) :: segment
    real(wp), intent(in) :: lambda             !! static stiffness over mass [1/s2]
    complex(wp), allocatable, intent(out) :: poles(:)    !! [1/s]
    complex(wp), allocatable :: roots(:)
    logical, allocatable :: is_mode(:)
    call all_roots([segment], lambda, 0.0_wp, [lambda], roots)
    call mark_mode(roots, sqrt(lambda*(1 + sum(segment%law%alpha))), is_mode)
    poles = pack(roots, .not. is_mode)
  end subroutine segment_poles

  !> Eigenvalues of a small dense matrix.
  subroutine eigenvalues(a, roots)
    real(wp), intent(inout) :: a(:, :)         !! [1/s], destroyed
    complex(wp), allocatable, intent(out) :: roots(:)    !! [1/s]
    real(wp) :: left(1, 1), right(1, 1)
    real(wp), allocatable :: wr(:), wi(:), work(:)
    integer :: n, info
    n = size(a, 1)
    allocate (wr(n), wi(n), work(8*n))
    call dgeev('N', 'N', n, a, n, wr, wi, left, 1, right, 1, work, size(work), info)
    roots = cmplx(wr, wi, wp)
  end subroutine eigenvalues
end module modal_eigenvalues
