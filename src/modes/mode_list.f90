!> The modes and poles found so far, with their shapes and residuals. Whether the list is complete:
!>   all eigenvalues computed: it is complete;
!>   a larger symmetric system: its undamped modes are counted;
!>   poles of a larger system: those of the modes that are asked for.
module mode_list
  use kinds, only: wp, pi
  use dynamic_stiffness, only: stiffness_system
  use natural_modes, only: highest_ratio
  use pole_iteration, only: same_shape
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: mode_set, residual_of, check_undamped, check_whole, describe_searched, say_what_is_missing

  integer, parameter, public :: undamped_mode = 0, vibration_mode = 1, further_mode = 2, real_pole = 3

  real(wp), parameter, public :: same_pole = 1.0e-6_wp !! distance of two estimates of one pole, over its modulus [-]

  real(wp), parameter :: least_gap = epsilon(1.0_wp)**0.25_wp   !! between squared frequencies, over the upper one [-]
  real(wp), parameter :: rounding_gap = 100*epsilon(1.0_wp) !! likewise, over the highest of all [-]
  integer, parameter :: further_modes = 5              !! modes beyond the list whose frequencies are accurate

  !> Modes and poles, one a column.
  type :: mode_set
    integer :: count = 0
    integer, allocatable :: kind(:)                    !! one of the four kinds
    integer, allocatable :: mode(:)                    !! number of the undamped mode that it belongs to
    complex(wp), allocatable :: lambda(:)              !! pole [1/s]
    real(wp), allocatable :: residual(:)               !! of T x, relative to the sum of its parts [-]
    complex(wp), allocatable :: x(:, :)                !! (n, count) shapes [m, rad, of any size]
    logical, allocatable :: matched(:)                 !! a search from a pole of the reduced system has ended at it
    complex(wp), allocatable :: unfound(:)             !! undamped modes asked for and not found, nearly [1/s]
    integer :: not_converged = 0                       !! searches for further poles that did not end at one
    integer :: alone = 0                               !! poles of viscoelastic terms alone, in which nothing moves: not in the list
    integer :: missing_undamped = 0                    !! modes that are counted and not in the list
    integer :: missing = 0                             !! poles that the list lacks though all eigenvalues were computed
    logical :: counted = .true.                        !! false: undamped modes cannot be counted for rounding
    character(:), allocatable :: note_undamped         !! sentence on completeness
    character(:), allocatable :: note_damped           !! likewise
  contains
    procedure :: clear
    procedure :: add => add_mode
    procedure :: find_alike
  end type mode_set

contains

  !> Makes the list empty.
  subroutine clear(self, n)
    class(mode_set), intent(out) :: self
    integer, intent(in) :: n                           !! mechanical unknowns
    allocate (self%kind(0), self%mode(0), self%lambda(0), self%residual(0), self%x(n, 0), self%matched(0), self%unfound(0))
    self%note_undamped = 'undamped modes: not counted'
    self%note_damped = ''
  end subroutine clear

  !> The number of a pole in the list with the same value whose shape is the nearest one, if possible of those that are not matched
  !> yet; 0: there is none, or the shape is none of those that they span. Shapes of a multiple pole are any of its space.
  integer function find_alike(self, ds, lambda, x, kind) result(number)
    class(mode_set), intent(in) :: self
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: x(:)                    !! (n) its shape [m, rad]
    integer, intent(in) :: kind                        !! undamped_mode, or any other for damped poles
    complex(wp) :: v(size(x)), mv(size(x))             ! what a listed shape has beside those before
    complex(wp) :: rest(size(x), 2)                    ! what they leave of the shape and of its conjugate
    real(wp) :: mass, near(self%count), best, length   ! [kg], shares [-]
    complex(wp), allocatable :: space(:, :), mass_space(:, :)
    integer :: j, k, side
    number = 0
    near = -1.0_wp
    rest(:, 1) = x
    rest(:, 2) = conjg(x)
    mass = abs(dot_product(x, ds%momentum(x)))
    allocate (space(size(x), 0), mass_space(size(x), 0))
    do j = 1, self%count
      if ((self%kind(j) == undamped_mode) .neqv. (kind == undamped_mode)) cycle
      if (min(abs(lambda - self%lambda(j)), abs(lambda - conjg(self%lambda(j)))) > same_pole*abs(lambda)) cycle
      v = self%x(:, j)
      mv = ds%momentum(v)
      length = abs(dot_product(v, mv))
      near(j) = max(abs(dot_product(x, mv)), abs(sum(x*mv)))**2/(mass*length)
      do k = 1, size(space, 2)
        v = v - dot_product(mass_space(:, k), v)*space(:, k)
      end do
      mv = ds%momentum(v)
      if (.not. abs(dot_product(v, mv)) > (1 - same_shape)*length) cycle   ! a double pole with one shape
      length = sqrt(abs(dot_product(v, mv)))
      space = reshape([space, v/length], [size(x), size(space, 2) + 1])
      mass_space = reshape([mass_space, mv/length], [size(x), size(space, 2)])
      do side = 1, 2
        rest(:, side) = rest(:, side) - dot_product(mv/length, rest(:, side))*(v/length)
      end do
    end do
    best = minval([(abs(dot_product(rest(:, side), ds%momentum(rest(:, side)))), side=1, 2)])
    if (size(space, 2) == 0 .or. best > (1 - same_shape)*mass) return
    if (any(near >= 0.0_wp .and. .not. self%matched)) where (self%matched) near = -1.0_wp
    number = maxloc(near, 1)
  end function find_alike

  !> |T x| against the sum of its parts, constraints left aside. A rigid motion has no forces: they are compared with those of a
  !> deformation as large.
  real(wp) function residual_of(ds, lambda, x, damping) result(residual)
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: x(:)                    !! (n) shape [m, rad]
    real(wp), intent(in) :: damping                    !! 1: the damped system, 0: the undamped one [-]
    complex(wp) :: y(ds%n + ds%rows), r(ds%n + ds%rows)
    real(wp) :: sizes(size(ds%values)), parts
    integer :: k
    call ds%set(lambda, damping)
    y = ds%padded(x)
    r = ds%times(ds%values, y)
    sizes = abs(lambda)**2*abs(ds%m) + abs(lambda)*abs(ds%gyro + damping*(ds%c - ds%gyro)) + abs(ds%k) + abs(ds%joint)
    do k = 1, size(ds%groups)
      associate (g => ds%groups(k))
        if (damping > 0.0_wp) sizes(g%entry) = sizes(g%entry) + abs(g%law%ratio(lambda)*g%value)
      end associate
    end do
    if (.not. abs(lambda) > 0.0_wp) y(1:ds%n) = maxval(abs(x))
    parts = norm2(abs(ds%times(cmplx(sizes, 0.0_wp, wp), cmplx(abs(y), 0.0_wp, wp))))
    residual = multiplier_free(ds, r)/max(parts, tiny(1.0_wp))
  end function residual_of

  !> Norm of a residual without the unknowns on which joints act: there a multiplier can balance it.
  pure real(wp) function multiplier_free(ds, r) result(size_r)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: r(:)         !! (n+rows) [N, N m]
    logical :: on_joints(ds%n)
    integer :: e
    on_joints = .false.
    do e = 1, size(ds%row)
      if (ds%col(e) > ds%n .and. ds%row(e) <= ds%n .and. abs(ds%joint(e)) > 0.0_wp) on_joints(ds%row(e)) = .true.
    end do
    size_r = norm2(pack(abs(r(1:ds%n)), .not. on_joints))
  end function multiplier_free

  !> Appends a mode.
  subroutine add_mode(self, kind, mode, lambda, residual, x)
    class(mode_set), intent(inout) :: self
    integer, intent(in) :: kind, mode
    complex(wp), intent(in) :: lambda       !! [1/s]
    real(wp), intent(in) :: residual        !! [-]
    complex(wp), intent(in) :: x(:)         !! (n) [m, rad]
    complex(wp), allocatable :: more(:, :)
    self%kind = [self%kind, kind]
    self%mode = [self%mode, mode]
    self%lambda = [self%lambda, lambda]
    self%residual = [self%residual, residual]
    self%matched = [self%matched, .false.]
    allocate (more(size(x), self%count + 1))
    more(:, 1:self%count) = self%x
    more(:, self%count + 1) = x
    call move_alloc(more, self%x)
    self%count = self%count + 1
  end subroutine add_mode

  !> Counts the undamped modes up to the highest one that is asked for.
  subroutine check_undamped(ds, whole, starts, modes)
    type(stiffness_system), intent(inout) :: ds
    logical, intent(in) :: whole                       !! all eigenvalues of the system were computed
    complex(wp), intent(in) :: starts(:)               !! all that are known, of a symmetric system in ascending order [1/s]
    type(mode_set), intent(inout) :: modes             !! the undamped ones
    real(wp) :: omega2(size(starts))                   ! [rad2/s2]
    integer :: k
    modes%note_undamped = 'undamped modes: '//to_text(modes%count)
    if (whole) then
      modes%note_undamped = modes%note_undamped//', complete, of all '//to_text(size(starts))
    else if (size(modes%unfound) > 0) then
      modes%note_undamped = modes%note_undamped//', '//to_text(size(modes%unfound))//' not found'
    else if (.not. ds%symmetric) then
      modes%note_undamped = modes%note_undamped//', not counted: there are gyroscopic terms or forces that follow the motion'
    else
      omega2 = -real(starts**2, wp)
      k = gap(omega2, count(omega2 <= maxval(-real(modes%lambda**2, wp))), rounding_gap*highest_ratio(ds))
      modes%counted = k > 0
      if (modes%counted) call count_below(ds, 0.5_wp*(omega2(k) + omega2(k + 1)), k, modes)
      if (.not. modes%counted) modes%note_undamped = modes%note_undamped//', not counted: frequencies are as close as '// &
                                                     'rounding of the stiffest motion'
    end if
  end subroutine check_undamped

  !> Compares the number of modes below a squared frequency with the number of those that are known.
  subroutine count_below(ds, sigma, known, modes)
    type(stiffness_system), intent(inout) :: ds
    real(wp), intent(in) :: sigma                      !! [rad2/s2]
    integer, intent(in) :: known
    type(mode_set), intent(inout) :: modes
    integer :: missing
    missing = ds%modes_below(sigma) - known
    modes%counted = missing >= 0
    if (.not. modes%counted) return
    modes%missing_undamped = missing
    modes%note_undamped = modes%note_undamped//', '
    if (missing > 0) modes%note_undamped = modes%note_undamped//to_text(missing)//' missing'
    if (missing == 0) modes%note_undamped = modes%note_undamped//'complete'
    if (sigma > 0.0_wp) modes%note_undamped = modes%note_undamped//' below '//hertz(sqrt(sigma))
  end subroutine count_below

  !> Number of the mode above which there is a gap wide enough to count in: that of the last one listed, or the next further one,
  !> or the next lower one; 0: there is none.
  pure integer function gap(omega2, last, rounding) result(k)
    real(wp), intent(in) :: omega2(:)                  !! [rad2/s2]
    integer, intent(in) :: last                        !! the last one listed
    real(wp), intent(in) :: rounding                   !! [rad2/s2]
    integer, allocatable :: candidates(:)
    candidates = [(k, k=last, min(last + further_modes, size(omega2) - 1)), (k, k=min(last, size(omega2)) - 1, 1, -1), 0]
    do k = 1, size(candidates) - 1
      associate (upper => omega2(candidates(k) + 1))
        if (upper - omega2(candidates(k)) > max(least_gap*abs(upper), rounding)) exit
      end associate
    end do
    k = candidates(k)
  end function gap

  !> Where all eigenvalues of the system were computed they are the poles, each listed or of a mode that was not asked for.
  subroutine check_whole(modes, expected, all_asked)
    type(mode_set), intent(inout) :: modes
    integer, intent(in) :: expected                    !! eigenvalues, one of each conjugate pair
    logical, intent(in) :: all_asked                   !! for all modes
    character(:), allocatable :: alone                 ! in words
    integer :: others
    alone = ''
    if (modes%alone > 0) alone = ' but for '//to_text(modes%alone)//' of viscoelastic terms alone, which move nothing to rounding'
    others = expected - count(modes%kind /= undamped_mode)
    if (all_asked .or. others < 0) modes%missing = others
    if (modes%missing /= 0) then
      modes%note_damped = 'poles: '//number_listed(modes)//', '//to_text(others)//' missing'
    else if (others == 0) then
      modes%note_damped = 'poles: '//either('complete, all '//number_listed(modes), number_listed(modes)//', complete'//alone, &
                                            modes%alone == 0)
    else
      modes%note_damped = 'poles: '//number_listed(modes)//', complete'//alone//', '//to_text(others)// &
                          ' of modes not asked for left out'
    end if
  end subroutine check_whole

  !> A larger system is searched for the poles of the modes that are asked for. With gyroscopic terms rigid motions take part in all
  !> relaxations of a material: many poles lie close together, and only some are found.
  subroutine describe_searched(symmetric, modes)
    logical, intent(in) :: symmetric                   !! the undamped system
    type(mode_set), intent(inout) :: modes
    modes%note_damped = 'poles: '//number_listed(modes)//', those of the modes asked for, residuals at most '// &
                        to_text(maxval([0.0_wp, modes%residual]))
    if (.not. symmetric .and. any(modes%kind == real_pole)) modes%note_damped = modes%note_damped// &
      '; of the relaxations not all: there are gyroscopic terms or forces that follow the motion'
    if (modes%not_converged > 0) modes%note_damped = modes%note_damped//'; '//to_text(modes%not_converged)// &
                                                 ' searches for further ones did not settle'
  end subroutine describe_searched

  !> How many poles are listed, in words.
  function number_listed(modes) result(words)
    type(mode_set), intent(in) :: modes
    character(:), allocatable :: words
    logical :: damped(modes%count)
    damped = modes%kind /= undamped_mode
    words = to_text(count(damped) + count(damped .and. modes%lambda%im > 0.0_wp))//' with conjugates'
  end function number_listed

  !> The sentence on what is missing in the list; empty where nothing is known to be missing.
  subroutine say_what_is_missing(modes, failed, words)
    type(mode_set), intent(in) :: modes
    logical, intent(out) :: failed                     !! modes that were asked for are missing
    character(:), allocatable, intent(out) :: words
    integer :: k
    failed = size(modes%unfound) > 0 .or. modes%missing_undamped > 0
    words = ''
    if (failed) then
      words = 'the modal analysis has not found all modes that were asked for: '//modes%note_undamped
      do k = 1, size(modes%unfound)
        words = words//', one near '//hertz(abs(modes%unfound(k)))
      end do
    else if (modes%missing /= 0 .or. modes%not_converged > 0) then
      words = 'poles may be missing in modes.txt: '//modes%note_damped
    else if (.not. modes%counted) then
      words = 'modes.txt may not be complete: '//modes%note_undamped
    end if
  end subroutine say_what_is_missing

  !> A modulus as a frequency.
  pure function hertz(modulus) result(text)
    real(wp), intent(in) :: modulus                    !! [rad/s]
    character(:), allocatable :: text
    text = to_text(modulus/(2*pi))//' Hz'
  end function hertz
end module mode_list
