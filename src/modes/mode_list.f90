!> The modes and poles found so far, with their shapes and residuals.
module mode_list
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  implicit none (type, external)
  private
  public :: mode_set, residual_of

  integer, parameter, public :: undamped_mode = 0, vibration_mode = 1, further_mode = 2, real_pole = 3

  real(wp), parameter, public :: same_pole = 1.0e-6_wp !! distance of two estimates of one pole, over its modulus [-]

  !> Modes and poles, one a column.
  type :: mode_set
    integer :: count = 0
    integer, allocatable :: kind(:)                    !! one of the four kinds
    integer, allocatable :: mode(:)                    !! number of the undamped mode that it belongs to
    complex(wp), allocatable :: lambda(:)              !! pole [1/s]
    real(wp), allocatable :: residual(:)               !! of T x, relative to the sum of its parts [-]
    complex(wp), allocatable :: x(:, :)                !! (n, count) shapes [m, rad, of any size]
    logical, allocatable :: matched(:)                 !! it matches a pole of the reduced system
    complex(wp), allocatable :: unfound(:)             !! undamped modes asked for and not found, nearly [1/s]
    integer :: not_converged = 0                       !! searches for further poles that did not end at one
    integer :: missing_undamped = 0                    !! modes that are counted and not in the list
    integer :: missing = 0                             !! poles that the list lacks though all eigenvalues were computed
    logical :: counted = .true.                        !! false: undamped modes cannot be counted for rounding
    character(:), allocatable :: note_undamped         !! sentence on completeness
    character(:), allocatable :: note_damped           !! likewise
  contains
    procedure :: clear
    procedure :: add => add_mode
    procedure :: find_alike
    procedure :: match
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

  !> The number of a pole in the list with the same value and shape, if possible one that is not matched yet; 0: none.
  integer function find_alike(self, ds, lambda, x, kind) result(number)
    class(mode_set), intent(in) :: self
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: lambda                  !! [1/s]
    complex(wp), intent(in) :: x(:)                    !! (n) its shape [m, rad]
    integer, intent(in) :: kind                        !! undamped_mode, or any other for damped poles
    complex(wp), allocatable :: mx(:), my(:)
    real(wp) :: alike
    integer :: j
    number = 0
    do j = 1, self%count
      if ((self%kind(j) == undamped_mode) .neqv. (kind == undamped_mode)) cycle
      if (min(abs(lambda - self%lambda(j)), abs(lambda - conjg(self%lambda(j)))) > same_pole*abs(lambda)) cycle
      mx = ds%times(cmplx(ds%m, 0.0_wp, wp), ds%padded(x))
      my = ds%times(cmplx(ds%m, 0.0_wp, wp), ds%padded(self%x(:, j)))
      alike = max(abs(dot_product(self%x(:, j), mx(1:ds%n)))**2, abs(sum(self%x(:, j)*mx(1:ds%n)))**2)
      alike = alike/(abs(dot_product(x, mx(1:ds%n)))*abs(dot_product(self%x(:, j), my(1:ds%n))))
      if (alike <= 0.99_wp) cycle
      number = j
      if (.not. self%matched(j)) return
    end do
  end function find_alike

  !> Marks a damped pole of the list, the given one or the nearest, as that of a pole of the reduced system. False where there is
  !> none, or it was marked before.
  logical function match(self, lambda, number) result(yes)
    class(mode_set), intent(inout) :: self
    complex(wp), intent(in) :: lambda                  !! [1/s]
    integer, intent(in), optional :: number            !! in the list, 0: none
    integer :: j
    if (present(number)) then
      j = number
    else
      j = minloc(abs(self%lambda - lambda), 1, self%kind /= undamped_mode .and. .not. self%matched)
      if (j > 0) then
        if (abs(self%lambda(j) - lambda) > 1.0e-7_wp*abs(lambda)) j = 0
      end if
    end if
    yes = j > 0
    if (yes) yes = .not. self%matched(j)
    if (yes) self%matched(j) = .true.
  end function match

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
end module mode_list
