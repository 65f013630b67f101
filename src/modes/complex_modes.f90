!> Modes and poles of the linearised mechanism, damping and GHM included: T(lambda) x + J^T mu = 0, J x = 0, a non-linear
!> eigenproblem that is exact in the modulus E(lambda). The undamped modes come from the subspace iteration, or with gyroscopic
!> terms from the system reduced on its motions. Each is followed to its vibration while the damping grows; what the internal
!> variables add starts from the poles of the reduced system. The argument principle says whether any is missing.
module complex_modes
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  use gyroscopic_modes, only: turning_basis
  use mode_list, only: mode_set, by_modulus, residual_of, undamped_mode, vibration_mode, further_mode, real_pole, same
  use natural_modes, only: natural_subspace, rounding_level
  use pole_check, only: check_undamped, check_damped, check_whole
  use pole_iteration, only: pole_state, start_pole, refine_pole, follow_damping, double_root, exact
  use process, only: caught_signal
  use reduced_system, only: reduced_model, reduced_poles
  implicit none (type, external)
  private
  public :: find_modes

  integer, parameter :: whole_below = 120              !! freedoms up to which a system is reduced on all its motions
  real(wp), parameter :: no_pole = 1.0e-7_wp           !! residual beyond which the iteration has not ended at a pole [-]
  real(wp), parameter :: short_step = 0.04_wp          !! of the damping where modes couple and their poles may meet [-]
  real(wp), parameter :: spread = 0.01_wp              !! of a double root by rounding, over its modulus [-]
  real(wp), parameter :: steady = 1.0e-10_wp           !! part of a pole that is rounding, over its modulus [-]

contains

  !> The lowest undamped modes and, with damping, their poles.
  subroutine find_modes(ds, asked, modes, ok)
    type(stiffness_system), intent(inout) :: ds
    integer, intent(in) :: asked                       !! how many modes
    type(mode_set), intent(out) :: modes
    logical, intent(out) :: ok
    type(reduced_model) :: model
    type(mode_set) :: unlisted
    complex(wp), allocatable :: starts(:), shapes(:, :), twins(:)
    real(wp), allocatable :: omega2(:), x(:, :)
    integer :: wanted, basis, free
    call modes%clear(ds%n)
    call unlisted%clear(ds%n)
    ok = .true.
    wanted = min(asked, ds%n - ds%rows)
    if (wanted == 0) modes%note_undamped = 'undamped modes: none'
    if (wanted == 0) return
    free = ds%n - ds%rows
    basis = wanted
    if (.not. (ds%symmetric .or. free <= whole_below)) basis = min(free, 2*wanted + 20)
    call natural_subspace(ds, basis, free <= whole_below, omega2, x, ok)
    if (ok) call undamped_starts(ds, omega2, x, model, starts, shapes, twins, ok)
    if (.not. ok) return
    if (wanted == ds%n - ds%rows) wanted = size(starts)    ! more than the freedoms where motions grow and their twins do not decay
    call list_undamped(ds, model, starts, shapes, wanted, modes)
    if (caught_signal() > 0) return
    call check_undamped(ds, model%p == free, [starts, twins], modes)
    if (.not. ds%damped) return
    call model%take_apart()
    call list_vibrations(ds, model, starts, shapes, modes, unlisted)
    call list_others(ds, model, shapes, modes, unlisted)
  end subroutine find_modes

  !> The undamped modes on the subspace: natural modes, or with gyroscopic terms or an unsymmetric K the poles of the reduced
  !> system in ascending order, of a diverging motion the one that grows.
  subroutine undamped_starts(ds, omega2, x, model, starts, shapes, twins, ok)
    type(stiffness_system), intent(in) :: ds
    real(wp), intent(in) :: omega2(:)                  !! (p) natural frequencies squared [rad2/s2]
    real(wp), intent(in) :: x(:, :)                    !! (n, p) natural modes [1/sqrt(kg)]
    type(reduced_model), intent(out) :: model
    complex(wp), allocatable, intent(out) :: starts(:)     !! (modes) [1/s]
    complex(wp), allocatable, intent(out) :: shapes(:, :)  !! (p, modes) on the basis of the model [-]
    complex(wp), allocatable, intent(out) :: twins(:)      !! poles that decay where another grows [1/s]
    logical, intent(out) :: ok
    type(reduced_poles) :: poles
    real(wp), allocatable :: turned(:, :)
    integer, allocatable :: order(:)
    integer :: j, p, rigid
    p = size(omega2)
    ok = .true.
    if (ds%symmetric) then
      call model%build(ds, x, [(abs(omega2(j)) <= rounding_level(ds, x(:, j)), j=1, p)])
      starts = merge((0.0_wp, 0.0_wp), sqrt(cmplx(-omega2, 0.0_wp, wp)), model%rigid)
      order = [(j, j=1, p)]
      allocate (twins(0))
    else
      call turning_basis(ds, x, turned, rigid, ok)
      if (.not. ok) return
      call model%build(ds, turned, [(j <= rigid, j=1, p)])
      call poles%find(model, [(j, j=1, p)], .false., ok)
      if (.not. ok) return
      twins = pack(poles%lambda, decays(poles%lambda))
      order = by_modulus(poles%lambda)
      order = pack(order, .not. decays(poles%lambda(order)))
      starts = [((0.0_wp, 0.0_wp), j=1, rigid), poles%lambda(order)]
    end if
    allocate (shapes(p, size(starts)))
    shapes = 0.0_wp
    rigid = size(starts) - size(order)
    do j = 1, size(starts)
      if (ds%symmetric .or. j <= rigid) then
        shapes(j, j) = 1.0_wp
      else
        shapes(:, j) = poles%shape(:, order(j - rigid))
      end if
    end do
  end subroutine undamped_starts

  !> Whether a search has stayed where it began: if its pole is listed, the reduced system has it more than once, with one
  !> shape. So has a body that is free to move and seen from its own turning axes.
  pure logical function copies(lambda, start) result(yes)
    complex(wp), intent(in) :: lambda, start           !! [1/s]
    yes = abs(lambda - start) <= 10*same*abs(lambda)
  end function copies

  !> Whether a search has made an estimate accurate, which of a double root is good to a few digits only.
  logical function leads_to(ds, damping, start, pole) result(yes)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: damping                    !! [-]
    complex(wp), intent(in) :: start                   !! [1/s]
    type(pole_state), intent(in) :: pole
    yes = copies(pole%lambda, start)
    if (.not. yes .and. abs(pole%lambda - start) <= spread*abs(start)) yes = double_root(ds, damping, pole)
  end function leads_to

  !> Whether an undamped pole decays.
  pure elemental logical function decays(lambda) result(yes)
    complex(wp), intent(in) :: lambda                  !! [1/s]
    yes = abs(lambda%im) <= 1.0e-9_wp*abs(lambda) .and. lambda%re < 0.0_wp
  end function decays

  !> The undamped modes that are asked for.
  subroutine list_undamped(ds, model, starts, shapes, wanted, modes)
    type(stiffness_system), intent(inout) :: ds
    type(reduced_model), intent(in) :: model
    complex(wp), intent(inout) :: starts(:)            !! [1/s]; those listed as they were found
    complex(wp), intent(in) :: shapes(:, :) !! (p, modes) [-]
    integer, intent(in) :: wanted
    type(mode_set), intent(inout) :: modes
    type(pole_state) :: pole
    integer :: j
    logical :: ok
    do j = 1, min(wanted, size(starts))
      if (caught_signal() > 0) return
      pole = start_pole(ds, starts(j), matmul(model%basis, shapes(:, j)))
      ok = .true.
      if (.not. ds%symmetric .and. abs(starts(j)) > 0.0_wp) then
        call refine_pole(ds, 0.0_wp, exact, pole, ok)
        if (abs(pole%lambda%re) <= steady*abs(pole%lambda)) pole%lambda%re = 0.0_wp
        if (abs(pole%lambda%im) <= steady*abs(pole%lambda)) pole%lambda%im = 0.0_wp
        if (ok) ok = pole%lambda%im >= 0.0_wp
        if (model%p == ds%n - ds%rows) then            ! an eigenvalue of the whole system: the search makes it accurate
          if (ok) ok = leads_to(ds, 0.0_wp, starts(j), pole)
          if (.not. ok) pole = start_pole(ds, starts(j), matmul(model%basis, shapes(:, j)))
          ok = .true.
        end if
        if (ok) ok = copies(pole%lambda, starts(j)) .or. modes%known(ds, pole%lambda, pole%x, undamped_mode) == 0
        if (.not. ok .and. pole%lambda%im > 0.0_wp) ok = double_root(ds, 0.0_wp, pole)
      end if
      if (ok) then
        starts(j) = pole%lambda
        call modes%add(undamped_mode, j, pole%lambda, residual_of(ds, pole%lambda, pole%x, 0.0_wp), pole%x)
      else
        modes%unfound = [modes%unfound, starts(j)]
        starts(j) = cmplx(0.0_wp, -1.0_wp, wp)         ! not named in the count
      end if
    end do
  end subroutine list_undamped

  !> Follows the modes to their vibrations; those of modes that are not asked for, where they couple to others that are, only
  !> so that they are not taken for something else.
  subroutine list_vibrations(ds, model, starts, shapes, modes, unlisted)
    type(stiffness_system), intent(inout) :: ds
    type(reduced_model), intent(in) :: model
    complex(wp), intent(in) :: starts(:)               !! [1/s]
    complex(wp), intent(in) :: shapes(:, :) !! (p, modes) [-]
    type(mode_set), intent(inout) :: modes, unlisted
    type(pole_state) :: pole
    integer :: part(size(starts)), j, listed           ! a mode is in the part of the motion that it holds most of
    logical :: vibrates
    listed = maxval([0, modes%mode])
    part = [(model%label(maxloc(abs(shapes(:, j)), 1)), j=1, size(part))]
    do j = 1, size(starts)
      if (caught_signal() > 0) return
      if (starts(j)%im <= 0.0_wp) cycle                ! rigid or diverging: no vibration to damp
      if (j > listed .and. all(part(1:listed) /= part(j))) cycle
      pole = start_pole(ds, starts(j), matmul(model%basis, shapes(:, j)))
      call follow_damping(ds, merge(1.0_wp, short_step, count(model%label == part(j)) == 1), pole, vibrates)
      if (vibrates) vibrates = .not. taken(modes) .and. .not. taken(unlisted)
      if (.not. vibrates) cycle
      if (j <= listed) then
        call modes%add(vibration_mode, j, pole%lambda, residual_of(ds, pole%lambda, pole%x, 1.0_wp), pole%x)
      else
        call unlisted%add(vibration_mode, j, pole%lambda, 0.0_wp, pole%x)
      end if
    end do
  contains
    !> Whether another mode has this vibration, unless the two are one without damping, too.
    logical function taken(list)
      type(mode_set), intent(in) :: list
      integer :: k
      k = list%known(ds, pole%lambda, pole%x, vibration_mode)
      taken = k > 0
      if (taken) taken = .not. copies(starts(j), starts(list%mode(k)))
    end function taken
  end subroutine list_vibrations

  !> The other poles of the modes that are asked for: each pole of the reduced system belongs to the mode that it resembles
  !> most. Those of other modes are named for the count only.
  subroutine list_others(ds, model, shapes, modes, unlisted)
    type(stiffness_system), intent(inout) :: ds
    type(reduced_model), intent(in) :: model
    complex(wp), intent(in) :: shapes(:, :) !! (p, modes) [-]
    type(mode_set), intent(inout) :: modes, unlisted
    type(reduced_poles) :: poles
    integer, allocatable :: members(:), ranks(:)
    complex(wp), allocatable :: others(:)
    integer :: part, j, i, listed, owner, zeros, expected
    logical :: ok, spanned, settled(size(shapes, 2))
    listed = maxval([0, modes%mode])
    settled = [(any(modes%kind == vibration_mode .and. modes%mode == j), j=1, size(settled))]
    allocate (ranks(size(ds%groups)), source=0)
    allocate (others(0))
    zeros = 0
    expected = 0
    spanned = model%exact .and. model%p == ds%n - ds%rows
    do part = 1, model%parts
      if (caught_signal() > 0) return
      members = pack([(j, j=1, model%p)], model%label == part)
      call poles%find(model, members, .true., ok)
      spanned = spanned .and. ok
      if (.not. ok) cycle
      ranks = ranks + poles%rank
      zeros = zeros + poles%zeros
      expected = expected + size(poles%lambda)
      do i = 1, size(poles%lambda)
        if (caught_signal() > 0) return
        owner = most_alike(poles%shape(:, i), shapes)
        if (modes%claims(poles%lambda(i))) cycle
        if (unlisted%claims(poles%lambda(i)) .or. (spanned .and. owner > listed)) cycle
        if (owner > listed) then
          call name_pole(ds, model, poles%lambda(i), poles%shape(:, i), modes, unlisted, others)
        else
          call list_pole(ds, model, spanned, poles%lambda(i), poles%shape(:, i), owner, settled(owner), modes, unlisted)
        end if
      end do
    end do
    if (spanned) then
      call check_whole(modes, expected, listed >= size(shapes, 2))
    else
      call check_damped(ds, zeros, others, ranks, modes, unlisted)
    end if
  end subroutine list_others

  !> Names a pole of a mode that is not asked for. Where it may lie inside the region of the count, the true one.
  subroutine name_pole(ds, model, lambda, shape, modes, unlisted, others)
    type(stiffness_system), intent(inout) :: ds
    type(reduced_model), intent(in) :: model
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: shape(:)                !! (p) [-]
    type(mode_set), intent(inout) :: modes, unlisted
    complex(wp), allocatable, intent(inout) :: others(:)   !! estimates [1/s]
    type(pole_state) :: pole
    logical :: ok
    ok = lambda%im > 0.0_wp .and. -lambda%re < 0.5_wp*abs(lambda) .and. &
         abs(lambda) < 1.5_wp*maxval([0.0_wp, abs(modes%lambda)])
    if (ok) then
      pole = start_pole(ds, lambda, matmul(model%basis, shape))
      call refine_pole(ds, 1.0_wp, exact, pole, ok)
    end if
    if (.not. ok) then
      others = [others, lambda]
    else if (modes%known(ds, pole%lambda, pole%x, vibration_mode) == 0 .and. &
             unlisted%known(ds, pole%lambda, pole%x, vibration_mode) == 0) then
      call unlisted%add(further_mode, 0, pole%lambda, 0.0_wp, pole%x)
    end if
  end subroutine name_pole

  !> Lists one pole of the reduced system as one of the whole, unless it is listed.
  subroutine list_pole(ds, model, spanned, lambda, shape, owner, settled, modes, unlisted)
    type(stiffness_system), intent(inout) :: ds
    type(reduced_model), intent(in) :: model
    logical, intent(in) :: spanned                     !! the reduced system is the whole one: its poles need no search
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: shape(:)                !! (p) [-]
    integer, intent(in) :: owner                       !! the undamped mode that it belongs to
    logical, intent(inout) :: settled                  !! that mode has its vibration
    type(mode_set), intent(inout) :: modes, unlisted
    type(pole_state) :: pole
    real(wp) :: residual
    integer :: kind
    logical :: ok
    pole = start_pole(ds, lambda, matmul(model%basis, shape))
    call refine_pole(ds, 1.0_wp, exact, pole, ok)
    if (ok) then
      if (abs(pole%lambda%im) <= steady*abs(pole%lambda)) pole%lambda%im = 0.0_wp
      if (pole%lambda%im < 0.0_wp) pole%x = conjg(pole%x)
      pole%lambda%im = abs(pole%lambda%im)
      residual = residual_of(ds, pole%lambda, pole%x, 1.0_wp)
      ok = residual <= no_pole
    end if
    if (ok) then
      if (modes%claims(pole%lambda, modes%known(ds, pole%lambda, pole%x, vibration_mode))) return
      if (unlisted%claims(pole%lambda, unlisted%known(ds, pole%lambda, pole%x, vibration_mode))) return
      ok = leads_to(ds, 1.0_wp, lambda, pole)
      if (.not. (ok .or. spanned)) ok = modes%known(ds, pole%lambda, pole%x, vibration_mode) == 0
    end if
    if (spanned .and. .not. ok) then
      pole = start_pole(ds, lambda, matmul(model%basis, shape))
      residual = residual_of(ds, lambda, pole%x, 1.0_wp)
    else if (.not. ok) then
      modes%lost = [modes%lost, lambda]
      return
    end if
    kind = merge(further_mode, vibration_mode, settled)
    if (pole%lambda%im <= 0.0_wp) kind = real_pole
    settled = settled .or. kind == vibration_mode
    call modes%add(kind, owner, pole%lambda, residual, pole%x)
    modes%claimed(modes%count) = .true.
  end subroutine list_pole

  !> Which of the modes resembles a shape most, in the sense of the mass matrix.
  pure integer function most_alike(shape, shapes) result(best)
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
  end function most_alike
end module complex_modes
