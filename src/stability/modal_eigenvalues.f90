!> Eigenvalues of one mode with viscoelastic terms: roots of s2 + c s + k + sum of a_r g_r(s), and which of them are the mode's own.
module modal_eigenvalues
  use kinds, only: wp
  use linear_matrices, only: linear_segment
  use reduced_system, only: reduced_model, reduced_poles
  use spectrum, only: no_part
  implicit none (type, external)
  private
  public :: modal_roots, find_mode_pair, term_poles, pair_of, refine_root, added_stiffness

  integer, parameter :: most_terms = 60          !! terms of a mode up to which all its eigenvalues are computed

contains

  !> Roots of s2 + c s + k + sum of a_r g_r(s): all of them. With very many terms the mode's own pair alone: `material_poles` has
  !> bounds of the others.
  subroutine modal_roots(segments, k, c, parts, roots)
    type(linear_segment), intent(in) :: segments(:)
    real(wp), intent(in) :: k                  !! static stiffness [1/s2]
    real(wp), intent(in) :: c                  !! damping [1/s]
    real(wp), intent(in) :: parts(:)           !! stiffness of every segment [1/s2]
    complex(wp), allocatable, intent(out) :: roots(:)    !! [1/s]
    real(wp) :: kept(size(parts))              ! those that are not left out, else 0 [1/s2]
    integer :: r
    logical :: ok
    kept = merge(parts, 0.0_wp, parts > no_part*(k + sum(parts)))
    ok = .false.
    if (sum([(size(segments(r)%law%alpha), r=1, size(kept))], kept > 0.0_wp) > most_terms) then
      call mode_pair(segments, k, c, kept, roots, ok)
    end if
    if (.not. ok) call all_roots(segments, k, c, kept, roots)
  end subroutine modal_roots

  !> The two roots near those of the instantaneous stiffness, by Newton's method.
  subroutine mode_pair(segments, k, c, parts, roots, ok)
    type(linear_segment), intent(in) :: segments(:)
    real(wp), intent(in) :: k                  !! static stiffness [1/s2]
    real(wp), intent(in) :: c                  !! damping [1/s]
    real(wp), intent(in) :: parts(:)           !! stiffness of every segment [1/s2]
    complex(wp), allocatable, intent(out) :: roots(:)    !! [1/s]
    logical, intent(out) :: ok
    integer :: i
    roots = pair_of(k + added_stiffness(segments, parts), c)
    do i = 1, 2
      call refine_root(segments, k, c, parts, roots(i), ok)
      if (.not. ok) return
    end do
    ok = abs(roots(1) - roots(2)) > 1.0e-6_wp*abs(roots(1))
  end subroutine mode_pair

  !> The roots of s2 + c s + k; of two that decay the faster one is the second.
  pure function pair_of(k, c) result(pair)
    real(wp), intent(in) :: k                  !! [1/s2]
    real(wp), intent(in) :: c                  !! [1/s]
    complex(wp) :: pair(2)                     !! [1/s]
    complex(wp) :: half                        ! of what lies between the two [1/s]
    half = sqrt(cmplx(c**2/4 - k, 0.0_wp, wp))
    pair = [-c/2 + half, -c/2 - half]
  end function pair_of

  !> What viscoelastic terms add to a mode's stiffness at once [1/s2].
  pure function added_stiffness(segments, parts) result(k)
    type(linear_segment), intent(in) :: segments(:)
    real(wp), intent(in) :: parts(:)           !! stiffness of every segment [1/s2]
    real(wp) :: k
    integer :: r
    k = 0.0_wp
    do r = 1, size(segments)
      k = k + parts(r)*sum(segments(r)%law%alpha)
    end do
  end function added_stiffness

  !> Newton's method for a root of s2 + c s + k + sum of a_r g_r(s).
  pure subroutine refine_root(segments, k, c, parts, root, ok)
    type(linear_segment), intent(in) :: segments(:)
    real(wp), intent(in) :: k                  !! static stiffness [1/s2]
    real(wp), intent(in) :: c                  !! damping [1/s]
    real(wp), intent(in) :: parts(:)           !! stiffness of every segment [1/s2]
    complex(wp), intent(inout) :: root         !! a guess, then the root [1/s]
    logical, intent(out) :: ok                 !! it converged
    complex(wp) :: f, df, s, step
    integer :: r, pass
    ok = .false.
    do pass = 1, 30
      s = root
      f = s**2 + c*s + k
      df = 2*s + c
      do r = 1, size(segments)
        if (.not. parts(r) > 0.0_wp) cycle
        if (segments(r)%law%is_pole(s)) return
        f = f + parts(r)*segments(r)%law%ratio(s)
        df = df + parts(r)*segments(r)%law%slope(s)
      end do
      step = f/df
      root = s - step
      ok = abs(step) <= 1.0e-13_wp*abs(s)
      if (ok) return
    end do
  end subroutine refine_root

  !> All roots in which the motion takes part, as poles of a system of one motion. Segments without stiffness have none.
  subroutine all_roots(segments, k, c, parts, roots)
    type(linear_segment), intent(in) :: segments(:)
    real(wp), intent(in) :: k                  !! static stiffness [1/s2]
    real(wp), intent(in) :: c                  !! damping [1/s]
    real(wp), intent(in) :: parts(:)           !! stiffness of every segment [1/s2]
    complex(wp), allocatable, intent(out) :: roots(:)    !! [1/s]
    type(reduced_model) :: model
    type(reduced_poles) :: poles
    integer, allocatable :: kept(:)
    integer :: r
    logical :: ok
    kept = pack([(r, r=1, size(parts))], parts > 0.0_wp)
    call model%make_room(1, [(segments(kept(r))%law, r=1, size(kept))])
    model%k = k
    model%c = c
    model%part(1, 1, :) = parts(kept)
    call model%find_scale()
    call poles%find(model, [1], .true., ok)
    roots = [poles%lambda, conjg(pack(poles%lambda, poles%lambda%im > 0.0_wp))]
  end subroutine all_roots

  !> Which roots are the mode's own pair: those nearest to its pair at instantaneous stiffness; the others are poles of terms.
  pure subroutine find_mode_pair(roots, square, c, is_mode)
    complex(wp), intent(in) :: roots(:)        !! [1/s]
    real(wp), intent(in) :: square             !! its squared frequency at instantaneous stiffness [rad2/s2]
    real(wp), intent(in) :: c                  !! its damping [1/s]
    logical, allocatable, intent(out) :: is_mode(:)
    complex(wp) :: pair(2)                     ! [1/s]
    integer :: k
    pair = pair_of(square, c)
    allocate (is_mode(size(roots)), source=.false.)
    if (size(roots) == 0) return
    k = minloc(abs(roots - pair(2)), dim=1)        ! the faster one of two that decay
    is_mode = min(abs(roots - roots(k)), abs(roots - conjg(roots(k)))) <= 1.0e-9_wp*abs(roots(k))
    if (count(is_mode) == 1) is_mode(minloc(abs(roots - pair(1)), dim=1, mask=.not. is_mode)) = .true.
  end subroutine find_mode_pair

  !> Poles of a segment's terms in a motion that its material or spring alone holds.
  subroutine term_poles(segment, lambda, poles)
    type(linear_segment), intent(in) :: segment
    real(wp), intent(in) :: lambda             !! static stiffness over mass [1/s2]
    complex(wp), allocatable, intent(out) :: poles(:)    !! [1/s]
    complex(wp), allocatable :: roots(:)
    logical, allocatable :: is_mode(:)
    call all_roots([segment], lambda, 0.0_wp, [lambda], roots)
    call find_mode_pair(roots, lambda*(1 + sum(segment%law%alpha)), 0.0_wp, is_mode)
    poles = pack(roots, .not. is_mode)
  end subroutine term_poles
end module modal_eigenvalues
