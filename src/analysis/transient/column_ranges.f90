!> Smallest and largest values of columns over the rows of a run, and which columns only rounding changes: pictures, studies and
!> estimates leave these out.
module column_ranges
  use kinds, only: wp
  use archive, only: value_archive
  use result_columns, only: result_column
  use scene_model, only: scene
  use step_control, only: error_norm, least_scale
  implicit none (type, external)
  private
  public :: rounded_share

  real(wp), parameter :: digits = 1.0e-10_wp  !! range over the largest value of the kind that is rounding [-]
  real(wp), parameter :: last_digits = 1.0e3_wp*epsilon(1.0_wp)   !! of the scene's size, where nothing has had time to vibrate [-]
  real(wp), parameter :: still_scene = 1.0e-3_wp    !! move of a scene that hardly moves, of its size [-]

  !> Ranges of all columns.
  type, public :: column_range
    real(wp), allocatable :: low(:), high(:)  !! (columns) [of the column]
  contains
    procedure :: begin
    procedure :: note
    procedure :: moved
    procedure :: still
    procedure :: exchange
  end type column_range

contains

  !> Before the first row.
  pure subroutine begin(self, columns)
    class(column_range), intent(inout) :: self
    integer, intent(in) :: columns
    self%low = spread(huge(1.0_wp), 1, columns)
    self%high = spread(-huge(1.0_wp), 1, columns)
  end subroutine begin

  !> A row.
  pure subroutine note(self, values)
    class(column_range), intent(inout) :: self
    real(wp), intent(in), contiguous :: values(:)   !! (columns) [of the column]
    integer :: k
    do k = 1, size(values)                    ! merge() in place of min() and max(): several at a time
      self%low(k) = merge(values(k), self%low(k), values(k) < self%low(k))
      self%high(k) = merge(values(k), self%high(k), values(k) > self%high(k))
    end do
  end subroutine note

  !> By how much each column moved; zero where that is rounding, beside the largest value of its kind [of the column].
  pure function moved(self, s, columns, time, share) result(range)
    class(column_range), intent(in) :: self
    type(scene), intent(in) :: s
    type(result_column), intent(in) :: columns(:)
    real(wp), intent(in) :: time              !! of the run [s]
    real(wp), intent(in) :: share             !! of the motion that counts (`rounded_share`) [-]
    real(wp) :: range(size(self%low))
    range = self%high - self%low
    where (.not. range > digits*sizes(self, s, columns, time, share)) range = 0.0_wp
  end function moved

  !> The value of a column that stands still but for rounding; zero where the value itself is rounding [of the column].
  pure function still(self, s, columns, time, share) result(value)
    class(column_range), intent(in) :: self
    type(scene), intent(in) :: s
    type(result_column), intent(in) :: columns(:)
    real(wp), intent(in) :: time              !! of the run [s]
    real(wp), intent(in) :: share             !! of the motion that counts (`rounded_share`) [-]
    real(wp) :: value(size(self%low))
    value = 0.5_wp*(self%low + self%high)
    where (.not. abs(value) > digits*sizes(self, s, columns, time, share)) value = 0.0_wp
  end function still

  !> Share of a motion over the scene's size within the run that counts as a scale. In a run so short that nothing moves by a
  !> thousandth of the size, such a motion is none, and rounding alone is left: of positions, and what stiffness makes of it.
  pure real(wp) function rounded_share(norm, stable, time) result(share)   ! [-]
    type(error_norm), intent(in) :: norm      !! with the largest rates
    real(wp), intent(in) :: stable            !! step of rk4, a measure of the fastest vibration; huge: nothing vibrates [s]
    real(wp), intent(in) :: time              !! of the run [s]
    share = 1.0_wp
    if (time*least_scale*maxval(norm%largest/norm%floor, norm%rate) > still_scene) return
    share = min(1.0_wp, last_digits/digits*(1 + min(time/stable, 1/last_digits)**2))
  end function rounded_share

  !> Scale of each column: the largest value of a column of the same unit, forces and moments by the scene's size; or the value of
  !> its unit in a share of a motion over that size within the run [of the column].
  pure function sizes(self, s, columns, time, share) result(largest)
    class(column_range), intent(in) :: self
    type(scene), intent(in) :: s
    type(result_column), intent(in) :: columns(:)
    real(wp), intent(in) :: time              !! of the run [s]
    real(wp), intent(in) :: share             !! [-]
    real(wp) :: largest(size(columns)), value(size(columns))
    real(wp) :: stress_by_moment              ! stress of a section that a unit moment bends [1/m3]
    integer :: k
    stress_by_moment = s%size**(-3)
    do k = 1, size(s%bodies)
      if (.not. allocated(s%bodies(k)%elements)) cycle
      stress_by_moment = max(stress_by_moment, maxval(s%bodies(k)%elements%fibre/s%bodies(k)%elements%second))
    end do
    value = max(abs(self%low), abs(self%high))
    do k = 1, size(columns)
      associate (unit => columns(k)%unit)
        largest(k) = max(share*unit_scale(trim(unit), sum(s%bodies%mass), s%size, time, stress_by_moment), largest_of(trim(unit)))
        if (unit == 'Nm') largest(k) = max(largest(k), s%size*largest_of('N'))
        if (unit == 'N') largest(k) = max(largest(k), largest_of('Nm')/s%size)
        if (unit == 'Pa') largest(k) = max(largest(k), stress_by_moment*largest_of('Nm'))
      end associate
    end do
  contains
    !> Of all columns of a unit; none: 0.
    pure real(wp) function largest_of(unit)        ! [of the unit]
      character(*), intent(in) :: unit
      largest_of = max(0.0_wp, maxval(value, columns%unit == unit))
    end function largest_of
  end function sizes

  !> A value of a unit, made of a mass, a length and a time [of the unit].
  pure function unit_scale(unit, mass, length, time, stress_by_moment) result(x)
    character(*), intent(in) :: unit
    real(wp), intent(in) :: mass, length, time   !! [kg], [m], [s]
    real(wp), intent(in) :: stress_by_moment  !! stress of a unit moment [1/m3]
    real(wp) :: x
    select case (unit(:scan(unit//'/', '/') - 1))
    case ('m')
      x = length
    case ('N')
      x = mass*length/time**2
    case ('Nm', 'J')
      x = mass*(length/time)**2
    case ('W')
      x = mass*(length/time)**2/time
    case ('Pa')
      x = mass*(length/time)**2*stress_by_moment
    case ('kg^.5*m')
      x = sqrt(mass)*length
    case default                              ! rad
      x = 1.0_wp
    end select
    if (index(unit, '/s') > 0) x = x/time
    if (index(unit, '/s2') > 0) x = x/time
  end function unit_scale

  !> Saves or restores the ranges.
  subroutine exchange(self, a)
    class(column_range), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%low, self%high)
  end subroutine exchange
end module column_ranges
