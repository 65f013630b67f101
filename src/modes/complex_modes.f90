!> Modes and poles of the linearised mechanism, damping and GHM included: T(lambda) x + J^T mu = 0, J x = 0, a non-linear
!> eigenproblem that is exact in the modulus E(lambda). The undamped modes come from the subspace iteration, or with gyroscopic
!> terms from the system reduced on its motions. Each is followed to its vibration while the damping grows; what the internal
!> variables add starts from the poles of the reduced system.
module complex_modes
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use gyroscopic_modes, only: mass_operator, add_motion, lowest_motions, rigid_motions_first
  use mode_list, only: check_undamped, check_whole, describe_searched, mode_set, residual_of, undamped_mode, vibration_mode, &
                       further_mode, real_pole, same_pole
  use natural_modes, only: lowest_natural_modes, rounding_level
  use pole_iteration, only: pole_state, start_pole, refine_pole, follow_damping, double_root, pole_change
  use posix, only: caught_signal
  use sorting, only: ascending
  use reduced_system, only: reduced_model, reduced_poles, usual_unknowns
  implicit none (type, external)
  private
  public :: find_modes

  integer, parameter :: spare_modes = 20               !! motions beside two for each mode that is asked for
  integer, parameter :: spare_motions = 40             !! likewise: a system that has no more is solved as a whole
  integer, parameter :: coupled_motions = 140          !! likewise where gyroscopic terms or an unsymmetric K couple all motions
  integer, parameter :: coupled_unknowns = 1000        !! likewise, or all are asked for: unknowns that are solved at once
  real(wp), parameter :: largest_residual = 1.0e-7_wp  !! residual of a pole [-]
  real(wp), parameter :: short_step = 0.04_wp          !! of the growing damping, where poles of coupled modes may meet [-]
  real(wp), parameter :: root_spread = 0.01_wp         !! distance of the two values of a double root, over its modulus [-]
  real(wp), parameter :: rounding_part = 1.0e-10_wp    !! real or imaginary part that is rounding, over the modulus [-]
  real(wp), parameter :: beside = 1.0e-4_wp            !! imaginary part of a second start, over the real one [-]
  real(wp), parameter :: least_share = 0.5_wp          !! share of its motion beyond which a pole belongs to modes [-]
  real(wp), parameter :: searched_share = 0.1_wp       !! likewise of an estimate of a pole [-]

  !> What the search for poles works with.
  type :: pole_search
    type(reduced_model) :: model                       !! the system on the natural modes
    complex(wp), allocatable :: starts(:)              !! undamped poles, of the listed ones the accurate values [1/s]
    complex(wp), allocatable :: shapes(:, :)           !! (p, modes) their shapes on the basis of the model [-]
    complex(wp), allocatable :: decaying(:)            !! poles that decay where another grows [1/s]
    integer :: listed = 0                              !! modes that are asked for, the first ones
    complex(wp), allocatable :: span(:, :)             !! (p, listed) orthonormal, these modes on the basis of the model [-]
    complex(wp), allocatable :: momenta(:, :)          !! (n, listed) M times that span [kg^1/2, kg^1/2 m]
    logical :: complete = .false.                      !! the reduced system is the whole one: its poles are all poles
    type(mode_set) :: unlisted                         !! vibrations of modes that are not asked for, and poles of these
  end type pole_search

contains

  !> The lowest undamped modes and, with damping, their poles.
  subroutine find_modes(ds, asked, modes, ok)
    type(stiffness_system), intent(inout), target :: ds
    integer, intent(in) :: asked                       !! how many modes
    type(mode_set), intent(out) :: modes
    logical, intent(out) :: ok
    type(pole_search) :: s
    real(wp), allocatable :: omega2(:), x(:, :)
    integer :: wanted, freedoms
    logical :: all_motions                             ! the system is reduced on all its motions
    call modes%clear(ds%n)
    call s%unlisted%clear(ds%n)
    ok = .true.
    freedoms = ds%n - ds%rows
    wanted = min(asked, freedoms)
    if (wanted == 0) modes%note_undamped = 'undamped modes: none'
    if (wanted == 0) return
    all_motions = freedoms <= 2*wanted + merge(spare_motions, coupled_motions, ds%symmetric)
    call lowest_natural_modes(ds, merge(wanted, wanted + spare_modes/2, ds%symmetric .or. all_motions), all_motions, omega2, x, ok)
    if (ok .and. .not. (ds%symmetric .or. all_motions)) call lowest_motions(ds, x, ok)
    if (ok) call undamped_starts(ds, omega2, x, merge(0, wanted, all_motions), s, ok)
    if (.not. ok) return
    if (wanted == freedoms) wanted = size(s%starts)    ! growing motions of which none decays: more modes than freedoms
    call list_undamped(ds, s, wanted, modes)
    if (caught_signal() > 0) return
    call check_undamped(ds, s%model%p == freedoms, [s%starts, s%decaying], modes)
    if (.not. ds%damped) return
    s%listed = maxval([0, modes%mode])
    call span_modes(ds, s)
    call s%model%split_into_parts(merge(usual_unknowns, coupled_unknowns, ds%symmetric .and. .not. all_motions))
    s%complete = s%model%exact .and. s%model%p == freedoms
    call list_vibrations(ds, s, modes)
    call list_others(ds, s, modes)
  end subroutine find_modes

  !> The undamped modes on the subspace: natural modes, or with gyroscopic terms or an unsymmetric K the poles of the reduced
  !> system in ascending order, of a diverging motion the one that grows.
  subroutine undamped_starts(ds, omega2, x, asked, s, ok)
    type(stiffness_system), intent(inout), target :: ds
    real(wp), intent(in) :: omega2(:)                  !! (p) natural frequencies squared [rad2/s2]
    real(wp), allocatable, intent(inout) :: x(:, :)    !! (n, p) natural modes, then with further motions [1/sqrt(kg)]
    integer, intent(in) :: asked                       !! modes to be answered by further motions; 0: x spans all motions
    type(pole_search), intent(inout) :: s
    logical, intent(out) :: ok
    type(reduced_poles) :: poles
    real(wp), allocatable :: rotated(:, :)
    logical, allocatable :: rigid_motions(:)
    integer, allocatable :: order(:)
    integer :: j, p, rigid
    p = size(x, 2)
    ok = .true.
    if (asked > 0) call add_responses(ds, omega2, asked, x)
    allocate (rigid_motions(size(x, 2)), source=.false.)
    if (ds%symmetric) then
      rigid_motions(1:p) = [(abs(omega2(j)) <= rounding_level(ds, x(:, j)), j=1, p)]
      call s%model%build(ds, x, rigid_motions)
      s%starts = merge((0.0_wp, 0.0_wp), sqrt(cmplx(-omega2, 0.0_wp, wp)), s%model%rigid(1:p))
      order = [(j, j=1, p)]
      allocate (s%decaying(0))
    else
      call rigid_motions_first(ds, x(:, 1:p), rotated, rigid, ok)
      if (.not. ok) return
      x(:, 1:p) = rotated
      rigid_motions(1:rigid) = .true.
      call s%model%build(ds, x, rigid_motions)
      call poles%find(s%model, [(j, j=1, s%model%p)], .false., ok)
      if (.not. ok) return
      s%decaying = pack(poles%lambda, decays(poles%lambda))
      order = ascending(abs(poles%lambda))
      order = pack(order, .not. decays(poles%lambda(order)))
      s%starts = [((0.0_wp, 0.0_wp), j=1, rigid), poles%lambda(order)]
    end if
    allocate (s%shapes(s%model%p, size(s%starts)))
    s%shapes = 0.0_wp
    rigid = size(s%starts) - size(order)
    do j = 1, size(s%starts)
      if (ds%symmetric .or. j <= rigid) then
        s%shapes(j, j) = 1.0_wp
      else
        s%shapes(:, j) = poles%shape(:, order(j - rigid))
      end if
    end do
  end subroutine undamped_starts

  !> Appends the responses to forces that damp the modes asked for: those of each viscoelastic material, of viscous damping and of
  !> gyroscopic terms in the shape of each mode. Poles consist of these motions, too, and a few natural modes hardly contain them.
  subroutine add_responses(ds, omega2, asked, x)
    type(stiffness_system), intent(inout), target :: ds
    real(wp), intent(in) :: omega2(:)                  !! (p) squared frequencies [rad2/s2]
    integer, intent(in) :: asked
    real(wp), allocatable, intent(inout) :: x(:, :)    !! (n, p), then (n, p + answers) mass-orthonormal [1/sqrt(kg)]
    type(mass_operator) :: op
    complex(wp) :: y(ds%n + ds%rows), mode(ds%n + ds%rows)
    integer :: j, r
    op%ds => ds
    call ds%set_real(max(omega2(asked), 1.0e-3_wp*omega2(size(omega2))))
    call ds%factor()
    do j = 1, asked
      mode = ds%padded(cmplx(x(:, j), 0.0_wp, wp))
      do r = -1, size(ds%groups)
        if (r == -1) y = ds%times(cmplx(ds%c - ds%gyro, 0.0_wp, wp), mode)
        if (r == 0) y = ds%times(cmplx(ds%gyro, 0.0_wp, wp), mode)
        if (r > 0) y = ds%stiffness_product(mode, r)
        y(ds%n + 1:) = 0.0_wp
        if (.not. any(abs(y) > 0.0_wp)) cycle
        call ds%solve(y)
        call add_motion(op, real(y(1:ds%n), wp), x)
      end do
    end do
  end subroutine add_responses

  !> Whether a search ended at its estimate. If that pole is listed already, it is a double one with a single shape, as of a free
  !> body in its own turning axes.
  pure logical function ended_near(lambda, start) result(yes)
    complex(wp), intent(in) :: lambda, start           !! [1/s]
    yes = abs(lambda - start) <= 10*same_pole*abs(lambda)
  end function ended_near

  !> Whether a search has made the estimate of a pole accurate. Of a double root the estimate has a few digits only.
  pure logical function is_accurate(ds, damping, start, pole) result(yes)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: damping                    !! [-]
    complex(wp), intent(in) :: start                   !! [1/s]
    type(pole_state), intent(in) :: pole
    yes = ended_near(pole%lambda, start)
    if (.not. yes .and. abs(pole%lambda - start) <= root_spread*abs(start)) yes = double_root(ds, damping, pole)
  end function is_accurate

  !> Whether an undamped pole decays.
  pure elemental logical function decays(lambda) result(yes)
    complex(wp), intent(in) :: lambda                  !! [1/s]
    yes = abs(lambda%im) <= 1.0e-9_wp*abs(lambda) .and. lambda%re < 0.0_wp
  end function decays

  !> The undamped modes that are asked for.
  subroutine list_undamped(ds, s, wanted, modes)
    type(stiffness_system), intent(inout) :: ds
    type(pole_search), intent(inout) :: s
    integer, intent(in) :: wanted
    type(mode_set), intent(inout) :: modes
    type(pole_state) :: pole
    integer :: j
    logical :: ok
    do j = 1, min(wanted, size(s%starts))
      if (caught_signal() > 0) return
      pole = start_of_mode(ds, s, j)
      ok = .true.
      if (.not. ds%symmetric .and. abs(s%starts(j)) > 0.0_wp) then
        call refine_pole(ds, 0.0_wp, pole_change, pole, ok)
        if (abs(pole%lambda%re) <= rounding_part*abs(pole%lambda)) pole%lambda%re = 0.0_wp
        if (abs(pole%lambda%im) <= rounding_part*abs(pole%lambda)) pole%lambda%im = 0.0_wp
        if (ok) ok = pole%lambda%im >= 0.0_wp
        if (s%model%p == ds%n - ds%rows) then            ! an eigenvalue of the whole system: the search makes it accurate
          if (ok) ok = is_accurate(ds, 0.0_wp, s%starts(j), pole)
          if (.not. ok) pole = start_of_mode(ds, s, j)
          ok = .true.
        end if
        if (ok) ok = ended_near(pole%lambda, s%starts(j)) .or. modes%find_alike(ds, pole%lambda, pole%x, undamped_mode) == 0
        if (.not. ok .and. pole%lambda%im > 0.0_wp) ok = double_root(ds, 0.0_wp, pole)
      end if
      if (ok) then
        s%starts(j) = pole%lambda
        call modes%add(undamped_mode, j, pole%lambda, residual_of(ds, pole%lambda, pole%x, 0.0_wp), pole%x)
      else
        modes%unfound = [modes%unfound, s%starts(j)]
      end if
    end do
  end subroutine list_undamped

  !> The estimate of a pole that an undamped mode is.
  type(pole_state) function start_of_mode(ds, s, j) result(pole)
    type(stiffness_system), intent(in) :: ds
    type(pole_search), intent(in) :: s
    integer, intent(in) :: j                           !! mode
    pole = start_pole(ds, s%starts(j), matmul(s%model%basis, s%shapes(:, j)))
  end function start_of_mode

  !> Follows the modes that are asked for to their vibrations.
  subroutine list_vibrations(ds, s, modes)
    type(stiffness_system), intent(inout) :: ds
    type(pole_search), intent(in) :: s
    type(mode_set), intent(inout) :: modes
    type(pole_state) :: pole
    integer :: j, k, part                              ! a mode belongs to the part in which it has its largest share
    logical :: vibrates
    do j = 1, s%listed
      if (caught_signal() > 0) return
      if (s%starts(j)%im <= 0.0_wp .or. .not. any(modes%mode == j)) cycle   ! rigid, diverging or not found: no vibration to damp
      part = s%model%label(maxloc(abs(s%shapes(:, j)), 1))
      pole = start_of_mode(ds, s, j)
      call follow_damping(ds, 0.0_wp, 1.0_wp, merge(1.0_wp, short_step, count(s%model%label == part) == 1), pole, vibrates)
      if (.not. vibrates) cycle
      k = modes%find_alike(ds, pole%lambda, pole%x, vibration_mode)
      if (k > 0) then                                  ! another mode has this vibration: are both one without damping, too?
        if (.not. ended_near(s%starts(j), s%starts(modes%mode(k)))) cycle
      end if
      call modes%add(vibration_mode, j, pole%lambda, residual_of(ds, pole%lambda, pole%x, 1.0_wp), pole%x)
    end do
  end subroutine list_vibrations

  !> Whether a vibrating pole belongs to a mode that is not asked for. Its damping is reduced to zero step by step: at the end it is
  !> none of the modes asked for, or one whose vibration is already listed.
  logical function belongs_to_other_mode(ds, s, modes, pole) result(yes)
    type(stiffness_system), intent(inout) :: ds
    type(pole_search), intent(in) :: s
    type(mode_set), intent(in) :: modes
    type(pole_state), intent(in) :: pole               !! damped
    type(pole_state) :: undamped
    integer :: j
    undamped = pole
    call follow_damping(ds, 1.0_wp, 0.0_wp, short_step, undamped, yes)
    do j = 1, merge(s%listed, 0, yes)
      if (ended_near(undamped%lambda, s%starts(j))) yes = yes .and. any(modes%kind == vibration_mode .and. modes%mode == j)
    end do
  end function belongs_to_other_mode

  !> The other poles of the modes that are asked for. A pole belongs to these modes if they together have more than half of its
  !> motion, by modal masses; among them it belongs to the one with the largest share. That needs no further modes, for any number
  !> of materials.
  subroutine list_others(ds, s, modes)
    type(stiffness_system), intent(inout) :: ds
    type(pole_search), intent(inout) :: s
    type(mode_set), intent(inout) :: modes
    type(reduced_poles) :: poles
    integer, allocatable :: members(:), order(:)
    integer :: part, j, i, k, expected
    logical :: ok
    expected = 0
    do part = 1, s%model%parts
      members = pack([(j, j=1, s%model%p)], s%model%label == part)
      call poles%find(s%model, members, .true., ok)
      s%complete = s%complete .and. ok
      if (.not. ok) modes%not_converged = modes%not_converged + 1
      if (.not. ok) cycle
      expected = expected + size(poles%lambda)
      order = ascending(abs(poles%lambda))      ! of each part the slowest first, however the eigenvalues have been found
      do k = 1, size(order)
        i = order(k)
        if (caught_signal() > 0) return
        if (modes%match(poles%lambda(i))) cycle
        if (s%unlisted%match(poles%lambda(i))) cycle
        if (sum(abs(matmul(conjg(transpose(s%span)), poles%shape(:, i)))**2) <= &
            merge(least_share, searched_share, s%complete)*sum(abs(poles%shape(:, i))**2)) cycle
        call list_pole(ds, s, size(members) > 1 .and. s%listed < size(s%starts), poles%lambda(i), poles%shape(:, i), modes)
      end do
    end do
    if (s%complete) then
      call check_whole(modes, expected, s%listed >= size(s%starts))
    else
      call describe_searched(ds%symmetric, modes)
    end if
  end subroutine list_others

  !> Lists one pole of the reduced system as one of the whole, unless it is listed, or the vibration of a mode that is not asked
  !> for.
  subroutine list_pole(ds, s, coupled, lambda, shape, modes)
    type(stiffness_system), intent(inout) :: ds
    type(pole_search), intent(inout) :: s
    logical, intent(in) :: coupled                     !! there are modes in its part that are not asked for
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: shape(:)                !! (p) [-]
    type(mode_set), intent(inout) :: modes
    type(pole_state) :: pole
    real(wp) :: residual, mass                         ! [-], [kg]
    integer :: owner, kind, k
    logical :: ok, converged
    call search(ds, lambda, matmul(s%model%basis, shape), pole, residual, converged)
    ok = converged
    if (ok) then
      if (modes%match(pole%lambda, modes%find_alike(ds, pole%lambda, pole%x, vibration_mode))) return
      if (s%unlisted%match(pole%lambda, s%unlisted%find_alike(ds, pole%lambda, pole%x, vibration_mode))) return
      if (pole%lambda%im > 0.0_wp .and. coupled) then
        if (belongs_to_other_mode(ds, s, modes, pole)) then
          call s%unlisted%add(vibration_mode, 0, pole%lambda, 0.0_wp, pole%x)
          return
        end if
      end if
      if (s%complete) ok = is_accurate(ds, 1.0_wp, lambda, pole)
    end if
    if (s%complete .and. .not. ok) then
      pole = start_pole(ds, lambda, matmul(s%model%basis, shape))
      residual = residual_of(ds, lambda, pole%x, 1.0_wp)
    else if (.not. s%complete) then
      mass = abs(dot_product(pole%x, ds%momentum(pole%x)))
      if (sum([(abs(dot_product(s%momenta(:, k), pole%x))**2, k=1, size(s%span, 2))]) <= least_share*mass) return
      if (.not. converged) modes%not_converged = modes%not_converged + 1
      if (.not. converged .or. abs(pole%lambda)**2 <= rounding_level(ds, abs(pole%x)/sqrt(mass))) return   ! or a rigid motion
      ok = modes%find_alike(ds, pole%lambda, pole%x, vibration_mode) == 0
      if (.not. ok) ok = ended_near(pole%lambda, lambda) .and. double_root(ds, 1.0_wp, pole)
      if (.not. ok) return
    end if
    owner = nearest_mode(shape, s%shapes)
    kind = further_mode
    if (owner <= s%listed .and. s%starts(owner)%im > 0.0_wp .and. &
        .not. any(modes%kind == vibration_mode .and. modes%mode == owner)) kind = vibration_mode
    if (owner > s%listed) owner = nearest_mode(shape, s%shapes(:, 1:s%listed))
    if (pole%lambda%im <= 0.0_wp) kind = real_pole
    call modes%add(kind, owner, pole%lambda, residual, pole%x)
    modes%matched(modes%count) = .true.
  end subroutine list_pole

  !> The damped pole that a search from an estimate finds. From real numbers it finds real poles alone, but two real estimates may
  !> stand for a pair that vibrates: then it starts again beside the real axis.
  subroutine search(ds, lambda, x, pole, residual, converged)
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: x(:)                    !! (n) shape [m, rad]
    type(pole_state), intent(out) :: pole
    real(wp), intent(out) :: residual                  !! [-]
    logical, intent(out) :: converged                  !! the search ended at a pole
    pole = start_pole(ds, lambda, x)
    call refine_pole(ds, 1.0_wp, pole_change, pole, converged)
    if (.not. (converged .or. abs(lambda%im) > 0.0_wp)) then
      pole = start_pole(ds, lambda*cmplx(1.0_wp, beside, wp), x)
      call refine_pole(ds, 1.0_wp, pole_change, pole, converged)
    end if
    if (abs(pole%lambda%im) <= rounding_part*abs(pole%lambda)) pole%lambda%im = 0.0_wp
    if (pole%lambda%im < 0.0_wp) pole%x = conjg(pole%x)
    pole%lambda%im = abs(pole%lambda%im)
    residual = residual_of(ds, pole%lambda, pole%x, 1.0_wp)
    converged = converged .and. residual <= largest_residual
  end subroutine search

  !> The space of the modes that are asked for, mass-orthonormal.
  subroutine span_modes(ds, s)
    type(stiffness_system), intent(in) :: ds
    type(pole_search), intent(inout) :: s
    complex(wp) :: v(s%model%p)                        ! [-]
    real(wp) :: before                                 ! [-]
    integer :: j, k, pass
    allocate (s%span(s%model%p, 0), s%momenta(ds%n, s%listed))
    do j = 1, s%listed
      v = s%shapes(:, j)
      before = norm2(abs(v))
      do pass = 1, 2
        do k = 1, size(s%span, 2)
          v = v - dot_product(s%span(:, k), v)*s%span(:, k)
        end do
      end do
      if (norm2(abs(v)) > rounding_part*before) s%span = reshape([s%span, v/norm2(abs(v))], [s%model%p, size(s%span, 2) + 1])
    end do
    s%momenta = s%momenta(:, 1:size(s%span, 2))
    do j = 1, size(s%span, 2)
      s%momenta(:, j) = ds%momentum(matmul(s%model%basis, s%span(:, j)))
    end do
  end subroutine span_modes

  !> The mode that has the largest part in a shape, by modal masses.
  pure integer function nearest_mode(shape, shapes) result(best)
    complex(wp), intent(in) :: shape(:)                !! (p) on a mass-orthonormal basis [-]
    complex(wp), intent(in) :: shapes(:, :)            !! (p, modes) [-]
    real(wp) :: alike, most
    integer :: j
    best = 1
    most = -1.0_wp
    do j = 1, size(shapes, 2)
      alike = abs(dot_product(shapes(:, j), shape))**2/real(dot_product(shapes(:, j), shapes(:, j)), wp)
      if (alike <= most) cycle
      most = alike
      best = j
    end do
  end function nearest_mode
end module complex_modes
