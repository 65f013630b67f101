!> Modes and poles of the linearised mechanism, damping and GHM included: T(lambda) x + J^T mu = 0, J x = 0, a non-linear
!> eigenproblem that is exact in the modulus E(lambda). The undamped modes come from the subspace iteration, or with gyroscopic
!> terms from the system reduced on its motions. Each is followed to its vibration while the damping grows; what the internal
!> variables add starts from the poles of the reduced system.
module complex_modes
  use kinds, only: wp, half_digits
  use dynamic_stiffness, only: stiffness_system
  use gyroscopic_modes, only: mass_operator, add_motion, lowest_motions, rigid_motions_first
  use mode_list, only: check_undamped, check_whole, describe_searched, mode_set, residual_of, undamped_mode, vibration_mode, &
                       further_mode, real_pole, same_pole
  use natural_modes, only: lowest_natural_modes, rounding_level
  use pole_iteration, only: pole_state, start_pole, refine_pole, follow_damping, double_root
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
  real(wp), parameter :: largest_residual = half_digits   !! residual of a pole [-]
  real(wp), parameter :: rounding_part = 1.0e-10_wp    !! real or imaginary part that is rounding, over the modulus [-]
  real(wp), parameter :: beside = epsilon(1.0_wp)**0.25_wp   !! imaginary part of a second start, over the real one [-]
  real(wp), parameter :: least_share = 0.5_wp          !! share of its motion beyond which a pole belongs to modes [-]

  !> What the search for poles works with.
  type :: pole_search
    type(reduced_model) :: model                       !! the system on the natural modes
    complex(wp), allocatable :: starts(:)              !! undamped poles, of the listed ones the accurate values [1/s]
    complex(wp), allocatable :: shapes(:, :)           !! (p, modes) their shapes on the basis of the model [-]
    complex(wp), allocatable :: decaying(:)            !! poles that decay where another grows [1/s]
    integer :: listed = 0                              !! modes that are asked for, the first ones
    complex(wp), allocatable :: span(:, :)             !! (p, listed) orthonormal, these modes on the basis of the model [-]
    logical :: complete = .false.                      !! the reduced system is the whole one: its poles are all poles
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
    call span_modes(s)
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
      rigid = p                                        ! shapes that are single motions of the basis
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
    do j = 1, rigid
      s%shapes(j, j) = 1.0_wp
    end do
    if (.not. ds%symmetric) s%shapes(:, rigid + 1:) = poles%shape(:, order)
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

  !> The pole at which a search ends, where that has made an estimate accurate, else the estimate. Of a double root the estimate has
  !> a few digits only.
  subroutine make_accurate(ds, damping, lambda, x, pole, residual)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: damping                    !! 1: the damped system, 0: the undamped one [-]
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: x(:)                    !! (n) shape [m, rad]
    type(pole_state), intent(inout) :: pole
    real(wp), intent(inout) :: residual                !! [-]
    if (residual <= largest_residual) then
      if (ended_near(pole%lambda, lambda) .or. double_root(ds, damping, pole)) return
    end if
    pole = start_pole(ds, lambda, x)
    residual = residual_of(ds, lambda, pole%x, damping)
  end subroutine make_accurate

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
    real(wp) :: residual                               ! [-]
    integer :: j
    logical :: ok
    do j = 1, min(wanted, size(s%starts))
      if (caught_signal() > 0) return
      associate (x => matmul(s%model%basis, s%shapes(:, j)))
        if (ds%symmetric .or. .not. abs(s%starts(j)) > 0.0_wp) then
          pole = start_pole(ds, s%starts(j), x)
          residual = residual_of(ds, pole%lambda, pole%x, 0.0_wp)
          ok = .true.
        else
          call search(ds, 0.0_wp, s%starts(j), x, pole, residual, ok)
          if (abs(pole%lambda%re) <= rounding_part*abs(pole%lambda)) pole%lambda%re = 0.0_wp
          if (s%model%p == ds%n - ds%rows) then          ! an eigenvalue of the whole system
            call make_accurate(ds, 0.0_wp, s%starts(j), x, pole, residual)
            ok = .true.
          else if (ok) then
            ok = is_new(ds, 0.0_wp, s%starts(j), pole, modes%find_alike(ds, pole%lambda, pole%x, undamped_mode))
          end if
        end if
      end associate
      if (ok) then
        s%starts(j) = pole%lambda
        call modes%add(undamped_mode, j, pole%lambda, residual, pole%x)
      else
        modes%unfound = [modes%unfound, s%starts(j)]
      end if
    end do
  end subroutine list_undamped

  !> Whether a pole found by a search is to be listed: it is not there yet, or a double one.
  logical function is_new(ds, damping, start, pole, listed) result(yes)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: damping                    !! [-]
    complex(wp), intent(in) :: start                   !! estimate from which it was searched [1/s]
    type(pole_state), intent(in) :: pole
    integer, intent(in) :: listed                      !! number of a listed pole like it, 0: none
    yes = listed == 0
    if (.not. yes) yes = ended_near(pole%lambda, start) .and. double_root(ds, damping, pole)
  end function is_new

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
      pole = start_pole(ds, s%starts(j), matmul(s%model%basis, s%shapes(:, j)))
      call follow_damping(ds, 1/sqrt(real(count(s%model%label == part), wp)), pole, vibrates)   ! it may meet those of its part
      if (.not. vibrates) cycle
      k = modes%find_alike(ds, pole%lambda, pole%x, vibration_mode)
      if (k > 0) cycle                                 ! another mode has this vibration
      call modes%add(vibration_mode, j, pole%lambda, residual_of(ds, pole%lambda, pole%x, 1.0_wp), pole%x)
    end do
  end subroutine list_vibrations

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
      modes%alone = modes%alone + poles%alone
      order = ascending(abs(poles%lambda))      ! of each part the slowest first, however the eigenvalues have been found
      do k = 1, size(order)
        i = order(k)
        if (caught_signal() > 0) return
        if (.not. belongs_to_asked(s, poles%shape(:, i), sum(abs(poles%shape(:, i))**2))) cycle
        call list_pole(ds, s, poles%lambda(i), poles%shape(:, i), modes)
      end do
    end do
    if (s%complete) then
      call check_whole(modes, expected, s%listed >= size(s%starts))
    else
      call describe_searched(ds%symmetric, modes)
    end if
  end subroutine list_others

  !> Whether the modes that are asked for together have more than half of a motion, by modal masses.
  pure logical function belongs_to_asked(s, shape, mass) result(yes)
    type(pole_search), intent(in) :: s
    complex(wp), intent(in) :: shape(:)                !! (p) its part in the basis of the model [kg^1/2, any]
    real(wp), intent(in) :: mass                       !! of the whole motion [kg, any]
    yes = sum(abs(matmul(conjg(transpose(s%span)), shape))**2) > least_share*mass
  end function belongs_to_asked

  !> Lists one pole of the reduced system as one of the whole, unless it is listed.
  subroutine list_pole(ds, s, lambda, shape, modes)
    type(stiffness_system), intent(inout) :: ds
    type(pole_search), intent(in) :: s
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: shape(:)                !! (p) [-]
    type(mode_set), intent(inout) :: modes
    type(pole_state) :: pole
    real(wp) :: residual                               ! [-]
    integer :: owner, kind, k
    logical :: converged
    associate (x => matmul(s%model%basis, shape))
      call search(ds, 1.0_wp, lambda, x, pole, residual, converged)
      k = 0
      if (converged) k = modes%find_alike(ds, pole%lambda, pole%x, vibration_mode)
      if (k > 0) then
        if (.not. modes%matched(k)) then
          modes%matched(k) = .true.
          return
        end if
      end if
      if (s%complete) then
        call make_accurate(ds, 1.0_wp, lambda, x, pole, residual)
      else
        if (.not. converged) modes%not_converged = modes%not_converged + 1
        if (.not. converged) return
        associate (p => ds%momentum(pole%x), mass => abs(dot_product(pole%x, ds%momentum(pole%x))))
          if (.not. belongs_to_asked(s, matmul(p, s%model%basis), mass)) return
          if (abs(pole%lambda)**2 <= rounding_level(ds, abs(pole%x)/sqrt(mass))) return   ! a rigid motion
        end associate
        if (.not. is_new(ds, 1.0_wp, lambda, pole, k)) return
      end if
    end associate
    owner = nearest_mode(shape, s%shapes)
    if (owner > s%listed .and. pole%lambda%im > 0.0_wp) return   ! the vibration of a mode that is not asked for
    kind = further_mode
    if (owner <= s%listed) then
      do k = 1, s%listed                               ! modes of one frequency: one that has no vibration yet
        if (.not. has_vibration(owner)) exit
        if (ended_near(s%starts(k), s%starts(owner)) .and. .not. has_vibration(k)) owner = k
      end do
      if (s%starts(owner)%im > 0.0_wp .and. .not. has_vibration(owner)) kind = vibration_mode
    end if
    if (owner > s%listed) owner = nearest_mode(shape, s%shapes(:, 1:s%listed))
    if (pole%lambda%im <= 0.0_wp) kind = real_pole
    call modes%add(kind, owner, pole%lambda, residual, pole%x)
    modes%matched(modes%count) = .true.
  contains
    !> Whether the list has the vibration of a mode.
    pure logical function has_vibration(mode) result(yes)
      integer, intent(in) :: mode
      yes = any(modes%kind == vibration_mode .and. modes%mode == mode)
    end function has_vibration
  end subroutine list_pole

  !> The pole that a search from an estimate finds. From real numbers it finds real poles alone, but two real estimates may
  !> stand for a pair that vibrates: then it starts again beside the real axis.
  subroutine search(ds, damping, lambda, x, pole, residual, converged)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: damping                    !! 1: the damped system, 0: the undamped one [-]
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: x(:)                    !! (n) shape [m, rad]
    type(pole_state), intent(out) :: pole
    real(wp), intent(out) :: residual                  !! [-]
    logical, intent(out) :: converged                  !! the search ended at a pole
    pole = start_pole(ds, lambda, x)
    call refine_pole(ds, damping, pole, converged)
    if (.not. (converged .or. abs(lambda%im) > 0.0_wp)) then
      pole = start_pole(ds, lambda*cmplx(1.0_wp, beside, wp), x)
      call refine_pole(ds, damping, pole, converged)
    end if
    if (abs(pole%lambda%im) <= rounding_part*abs(pole%lambda)) pole%lambda%im = 0.0_wp
    if (pole%lambda%im < 0.0_wp) pole%x = conjg(pole%x)
    pole%lambda%im = abs(pole%lambda%im)
    residual = residual_of(ds, pole%lambda, pole%x, damping)
    converged = converged .and. residual <= largest_residual
  end subroutine search

  !> The space of the modes that are asked for, mass-orthonormal.
  subroutine span_modes(s)
    type(pole_search), intent(inout) :: s
    complex(wp) :: v(s%model%p)                        ! [-]
    real(wp) :: before                                 ! [-]
    integer :: j, k, pass
    allocate (s%span(s%model%p, 0))
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
  end subroutine span_modes

  !> The mode that has the largest part in a shape, by modal masses.
  pure integer function nearest_mode(shape, shapes) result(best)
    complex(wp), intent(in) :: shape(:)                !! (p) on a mass-orthonormal basis [-]
    complex(wp), intent(in) :: shapes(:, :)            !! (p, modes) [-]
    best = maxloc(abs(matmul(conjg(transpose(shapes)), shape))/sqrt(sum(abs(shapes)**2, 1)), 1)
  end function nearest_mode
end module complex_modes
