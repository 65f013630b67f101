!> The modes and poles found so far, with their shapes and residuals.
module mode_list
  use kinds, only: wp
  use dynamic_stiffness, only: stiffness_system
  implicit none (type, external)
  private
  public :: mode_set, padded, residual_of, known_slope

  integer, parameter, public :: undamped_mode = 0, vibration_mode = 1, further_mode = 2, real_pole = 3

  !> Modes and poles, one a column.
  type :: mode_set
    integer :: count = 0
    integer, allocatable :: kind(:)                    !! one of the four kinds
    integer, allocatable :: mode(:)                    !! number of the undamped mode that it belongs to
    complex(wp), allocatable :: lambda(:)              !! pole [1/s]
    real(wp), allocatable :: residual(:)               !! of T x, relative to the sum of its parts [-]
    complex(wp), allocatable :: x(:, :)                !! (n, count) shapes
    integer :: lost = 0                                !! searches that ended at poles found before
  contains
    procedure :: add => add_mode
    procedure :: known
  end type mode_set

contains

  !> A vector of mechanical unknowns with zero multipliers.
  pure function padded(ds, x) result(y)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: x(:)
    complex(wp) :: y(ds%n + ds%rows)
    y = 0.0_wp
    y(1:ds%n) = x(1:ds%n)
  end function padded

  !> Sum of 1/(lambda - known poles).
  pure complex(wp) function known_slope(modes, lambda, damping) result(slope)
    type(mode_set), intent(in) :: modes
    complex(wp), intent(in) :: lambda
    real(wp), intent(in) :: damping
    integer :: j
    slope = 0.0_wp
    do j = 1, modes%count
      if ((modes%kind(j) == undamped_mode) .neqv. (damping <= 0.0_wp)) cycle
      if (abs(lambda - modes%lambda(j)) > 1.0e-14_wp*abs(lambda)) slope = slope + 1.0_wp/(lambda - modes%lambda(j))
      if (abs(modes%lambda(j)%im) > 0.0_wp .and. abs(lambda - conjg(modes%lambda(j))) > 1.0e-14_wp*abs(lambda)) then
        slope = slope + 1.0_wp/(lambda - conjg(modes%lambda(j)))
      end if
    end do
  end function known_slope

  !> Whether a pole with the same shape has been found before.
  pure logical function known(self, ds, lambda, x, damping) result(yes)
    class(mode_set), intent(in) :: self
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: lambda, x(:)
    real(wp), intent(in) :: damping
    complex(wp), allocatable :: mx(:)
    real(wp) :: alike
    integer :: j
    yes = .false.
    do j = 1, self%count
      if ((self%kind(j) == undamped_mode) .neqv. (damping <= 0.0_wp)) cycle
      if (min(abs(lambda - self%lambda(j)), abs(lambda - conjg(self%lambda(j)))) > 1.0e-8_wp*abs(lambda)) cycle
      mx = ds%times(cmplx(ds%m, 0.0_wp, wp), padded(ds, x))
      alike = abs(dot_product(self%x(:, j), mx(1:ds%n)))**2
      alike = max(alike, abs(sum(self%x(:, j)*mx(1:ds%n)))**2)
      alike = alike/abs(dot_product(x, mx(1:ds%n)))
      mx = ds%times(cmplx(ds%m, 0.0_wp, wp), padded(ds, self%x(:, j)))
      alike = alike/abs(dot_product(self%x(:, j), mx(1:ds%n)))
      yes = yes .or. alike > 0.9_wp
    end do
  end function known

  !> |T x| against the sum of its parts, constraints left aside.
  real(wp) function residual_of(ds, lambda, x, damping) result(residual)
    type(stiffness_system), intent(inout) :: ds
    complex(wp), intent(in) :: lambda, x(:)
    real(wp), intent(in) :: damping
    complex(wp) :: y(ds%n + ds%rows), r(ds%n + ds%rows)
    real(wp) :: parts
    call ds%set(lambda, damping)
    y = padded(ds, x)
    r = ds%times(ds%values, y)
    parts = norm2(abs(ds%times(cmplx(abs(ds%values), 0.0_wp, wp), cmplx(abs(y), 0.0_wp, wp))))
    residual = multiplier_free(ds, r)/max(parts, tiny(1.0_wp))
  end function residual_of

  !> Norm of the part of a residual that no multiplier can balance (least squares on J by a bordered solve with the unit matrix
  !> would be dearer; rows where joints act are left out).
  pure real(wp) function multiplier_free(ds, r) result(size_r)
    type(stiffness_system), intent(in) :: ds
    complex(wp), intent(in) :: r(:)
    logical :: held(ds%n)
    integer :: e
    held = .false.
    do e = 1, size(ds%row)
      if (ds%col(e) > ds%n .and. ds%row(e) <= ds%n .and. abs(ds%joint(e)) > 0.0_wp) held(ds%row(e)) = .true.
    end do
    size_r = norm2(pack(abs(r(1:ds%n)), .not. held))
  end function multiplier_free

  !> Appends a mode.
  subroutine add_mode(self, kind, mode, lambda, residual, x)
    class(mode_set), intent(inout) :: self
    integer, intent(in) :: kind, mode
    complex(wp), intent(in) :: lambda
    real(wp), intent(in) :: residual
    complex(wp), intent(in) :: x(:)
    complex(wp), allocatable :: more(:, :)
    self%kind = [self%kind, kind]
    self%mode = [self%mode, mode]
    self%lambda = [self%lambda, lambda]
    self%residual = [self%residual, residual]
    allocate (more(size(x), self%count + 1))
    more(:, 1:self%count) = self%x
    more(:, self%count + 1) = x
    call move_alloc(more, self%x)
    self%count = self%count + 1
  end subroutine add_mode
end module mode_list
