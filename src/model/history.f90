!> Histories: functions of time that scale loads and lead drives (input/README.md, &history). Each gives its value, two
!> derivatives, its integral from t = 0 in closed form, and the times at which it is not smooth.
module history
  use kinds, only: wp, pi
  implicit none (type, external)
  private
  public :: history_function, corner, fit_table, drive_corners

  integer, parameter, public :: kind_polynomial = 1, kind_sine = 2, kind_ramp = 3, kind_cycloid = 4, kind_table = 5, &
                                kind_pulse = 6

  !> A time at which a history is not smooth: order 0 a jump, 1 a jump of slope, 2 of curvature, 3 of the third derivative.
  type :: corner
    real(wp) :: time = 0.0_wp   !! [s]
    integer :: order = 0
  end type corner

  !> One history. Values carry the unit of what it scales.
  type :: history_function
    character(32) :: name = ''
    integer :: kind = kind_polynomial
    real(wp), allocatable :: c(:)              !! polynomial coefficients [unit/s^k]
    real(wp) :: offset = 0.0_wp, amplitude = 0.0_wp   !! sine [unit]
    real(wp) :: omega = 0.0_wp                 !! sine, 2 pi frequency [rad/s]
    real(wp) :: phase = 0.0_wp                 !! sine [rad]
    real(wp) :: v0 = 0.0_wp, v1 = 0.0_wp       !! ramp, cycloid: end values; pulse: v1 [unit]
    real(wp) :: start = 0.0_wp, finish = 0.0_wp   !! [s]
    real(wp), allocatable :: t(:)              !! table [s]
    real(wp), allocatable :: y(:)              !! table [unit]
    real(wp), allocatable :: m(:)              !! table: second derivatives of the spline [unit/s2]
    real(wp), allocatable :: area(:)           !! table: integral from t(1) [unit s]
  contains
    procedure :: evaluate => history_evaluate
    procedure :: integral => history_integral
    procedure :: corners => history_corners
  end type history_function

contains

  !> Value and two derivatives at t. With left = .true. a jump at t (of the value or a derivative) is not yet felt: the limit
  !> from below.
  pure subroutine history_evaluate(self, t, left, h)
    class(history_function), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    logical, intent(in) :: left
    real(wp), intent(out) :: h(0:2)     !! value, first and second derivative [unit, unit/s, unit/s2]
    real(wp) :: x
    integer :: k
    h = 0.0_wp
    select case (self%kind)
    case (kind_polynomial)
      do k = size(self%c), 1, -1
        h(2) = h(2)*t + 2*h(1)
        h(1) = h(1)*t + h(0)
        h(0) = h(0)*t + self%c(k)
      end do
    case (kind_sine)
      x = self%omega*t + self%phase
      h(0) = self%offset + self%amplitude*sin(x)
      h(1) = self%amplitude*self%omega*cos(x)
      h(2) = -self%amplitude*self%omega**2*sin(x)
    case (kind_ramp, kind_cycloid)
      call rise(self, t, h)
    case (kind_table)
      if (reached(t, self%t(1), left) .and. .not. reached(t, self%t(size(self%t)), left)) then
        call spline(self, min(max(t, self%t(1)), self%t(size(self%t))), h)
      else
        h(0) = merge(self%y(1), self%y(size(self%t)), t < self%t(1) + 0.5_wp*(self%t(size(self%t)) - self%t(1)))
      end if
    case default   ! kind_pulse
      if (reached(t, self%start, left) .and. .not. reached(t, self%finish, left)) h(0) = self%v1
    end select
  end subroutine history_evaluate

  !> Whether time t has reached a corner, within the rounding of times that are sums of steps.
  pure function reached(t, at, left) result(yes)
    real(wp), intent(in) :: t, at       !! [s]
    logical, intent(in) :: left         !! limit from below
    logical :: yes
    real(wp) :: slack
    slack = 16*spacing(max(abs(t), abs(at)))
    yes = t >= merge(at + slack, at - slack, left)
  end function reached

  !> Ramp (quintic) and cycloid between start and finish.
  pure subroutine rise(self, t, h)
    class(history_function), intent(in) :: self
    real(wp), intent(in) :: t
    real(wp), intent(inout) :: h(0:2)
    real(wp) :: s, width, dv
    width = self%finish - self%start
    dv = self%v1 - self%v0
    s = (t - self%start)/width
    if (s <= 0.0_wp) then
      h(0) = self%v0
    else if (s >= 1.0_wp) then
      h(0) = self%v1
    else if (self%kind == kind_ramp) then
      h(0) = self%v0 + dv*s**3*(10 + s*(6*s - 15))
      h(1) = dv*30*s**2*(1 + s*(s - 2))/width
      h(2) = dv*60*s*(1 + s*(2*s - 3))/width**2
    else
      h(0) = self%v0 + dv*(s - sin(2*pi*s)/(2*pi))
      h(1) = dv*(1 - cos(2*pi*s))/width
      h(2) = dv*2*pi*sin(2*pi*s)/width**2
    end if
  end subroutine rise

  !> Cubic spline of a table, from its first to its last time.
  pure subroutine spline(self, t, h)
    class(history_function), intent(in) :: self
    real(wp), intent(in) :: t
    real(wp), intent(inout) :: h(0:2)
    real(wp) :: w, a, b
    integer :: i
    i = interval(self%t, t)
    w = self%t(i + 1) - self%t(i)
    a = (self%t(i + 1) - t)/w
    b = (t - self%t(i))/w
    h(0) = a*self%y(i) + b*self%y(i + 1) + ((a**3 - a)*self%m(i) + (b**3 - b)*self%m(i + 1))*w**2/6
    h(1) = (self%y(i + 1) - self%y(i))/w + ((1 - 3*a**2)*self%m(i) + (3*b**2 - 1)*self%m(i + 1))*w/6
    h(2) = a*self%m(i) + b*self%m(i + 1)
  end subroutine spline

  !> Index i with x(i) <= t < x(i+1), by bisection.
  pure function interval(x, t) result(i)
    real(wp), intent(in) :: x(:), t
    integer :: i, k, j
    i = 1
    j = size(x)
    do while (j - i > 1)
      k = (i + j)/2
      if (x(k) <= t) then
        i = k
      else
        j = k
      end if
    end do
  end function interval

  !> Integral of the history from 0 to t [unit s].
  pure function history_integral(self, t) result(area)
    class(history_function), intent(in) :: self
    real(wp), intent(in) :: t           !! [s]
    real(wp) :: area
    area = antiderivative(self, t) - antiderivative(self, 0.0_wp)
  end function history_integral

  !> An antiderivative.
  pure function antiderivative(self, t) result(f)
    class(history_function), intent(in) :: self
    real(wp), intent(in) :: t
    real(wp) :: f, s, width
    integer :: k
    f = 0.0_wp
    select case (self%kind)
    case (kind_polynomial)
      do k = size(self%c), 1, -1
        f = f*t + self%c(k)/k
      end do
      f = f*t
    case (kind_sine)
      f = self%offset*t
      if (abs(self%omega) > 0.0_wp) then
        f = f - self%amplitude/self%omega*cos(self%omega*t + self%phase)
      else
        f = f + self%amplitude*sin(self%phase)*t
      end if
    case (kind_ramp, kind_cycloid)
      width = self%finish - self%start
      s = min(max((t - self%start)/width, 0.0_wp), 1.0_wp)
      if (self%kind == kind_ramp) then
        f = s**4*(2.5_wp + s*(s - 3))
      else
        f = s**2/2 + (cos(2*pi*s) - 1)/(4*pi**2)
      end if
      f = self%v0*(t - self%start) + (self%v1 - self%v0)*(width*f + max(t - self%finish, 0.0_wp))
    case (kind_table)
      f = table_area(self, t)
    case default   ! kind_pulse
      f = self%v1*(min(max(t, self%start), self%finish) - self%start)
    end select
  end function antiderivative

  !> Antiderivative of a table.
  pure function table_area(self, t) result(f)
    class(history_function), intent(in) :: self
    real(wp), intent(in) :: t
    real(wp) :: f, w, a, b
    integer :: i, n
    n = size(self%t)
    if (t <= self%t(1)) then
      f = self%y(1)*(t - self%t(1))
    else if (t >= self%t(n)) then
      f = self%area(n) + self%y(n)*(t - self%t(n))
    else
      i = interval(self%t, t)
      w = self%t(i + 1) - self%t(i)
      a = (self%t(i + 1) - t)/w
      b = (t - self%t(i))/w
      f = self%area(i) + w*(self%y(i)*(1 - a**2) + self%y(i + 1)*b**2)/2 &
          + w**3/24*(self%m(i)*(-(a**2 - 1)**2) + self%m(i + 1)*(b**4 - 2*b**2))
    end if
  end function table_area

  !> Second derivatives of the not-a-knot cubic spline through a table, and its running integral.
  subroutine fit_table(self)
    type(history_function), intent(inout) :: self    !! t and y are set; m and area are computed
    real(wp), allocatable :: w(:), diag(:), up(:), low(:), rhs(:)
    integer :: n, i
    n = size(self%t)
    allocate (self%m(n), self%area(n), w(n - 1), diag(n), up(n), low(n), rhs(n))
    self%m = 0.0_wp
    w = self%t(2:n) - self%t(1:n - 1)
    if (n == 3) then      ! the parabola
      self%m = 2*((self%y(3) - self%y(2))/w(2) - (self%y(2) - self%y(1))/w(1))/(w(1) + w(2))
    else if (n > 3) then
      do i = 2, n - 1
        low(i) = w(i - 1)
        diag(i) = 2*(w(i - 1) + w(i))
        up(i) = w(i)
        rhs(i) = 6*((self%y(i + 1) - self%y(i))/w(i) - (self%y(i) - self%y(i - 1))/w(i - 1))
      end do
      ! third derivative continuous at the second and the last but one point: m(1) and m(n) eliminated
      diag(2) = diag(2) + w(1)*(w(1) + w(2))/w(2)
      up(2) = up(2) - w(1)**2/w(2)
      diag(n - 1) = diag(n - 1) + w(n - 1)*(w(n - 2) + w(n - 1))/w(n - 2)
      low(n - 1) = low(n - 1) - w(n - 1)**2/w(n - 2)
      do i = 3, n - 1
        diag(i) = diag(i) - low(i)/diag(i - 1)*up(i - 1)
        rhs(i) = rhs(i) - low(i)/diag(i - 1)*rhs(i - 1)
      end do
      self%m(n - 1) = rhs(n - 1)/diag(n - 1)
      do i = n - 2, 2, -1
        self%m(i) = (rhs(i) - up(i)*self%m(i + 1))/diag(i)
      end do
      self%m(1) = ((w(1) + w(2))*self%m(2) - w(1)*self%m(3))/w(2)
      self%m(n) = ((w(n - 2) + w(n - 1))*self%m(n - 1) - w(n - 1)*self%m(n - 2))/w(n - 2)
    end if
    self%area(1) = 0.0_wp
    do i = 1, n - 1
      self%area(i + 1) = self%area(i) + w(i)*(self%y(i) + self%y(i + 1))/2 - w(i)**3/24*(self%m(i) + self%m(i + 1))
    end do
  end subroutine fit_table

  !> The times at which the history is not smooth, with the order of what jumps there.
  pure function history_corners(self) result(list)
    class(history_function), intent(in) :: self
    type(corner), allocatable :: list(:)
    integer :: i, n
    real(wp) :: scale, h(0:2), slope
    select case (self%kind)
    case (kind_pulse)
      list = [corner(self%start, 0), corner(self%finish, 0)]
    case (kind_ramp, kind_cycloid)
      list = [corner(self%start, 3), corner(self%finish, 3)]
    case (kind_table)
      n = size(self%t)
      allocate (list(n))
      scale = maxval(abs(self%y - self%y(1)))/(self%t(n) - self%t(1))
      do i = 1, n
        list(i) = corner(self%t(i), 3)
      end do
      do i = 1, n, n - 1
        call spline(self, self%t(i) + merge(1, -1, i == 1)*1.0e-9_wp*(self%t(n) - self%t(1)), h)
        slope = abs(h(1))
        list(i)%order = merge(1, 2, slope > 1.0e-6_wp*scale)
        if (list(i)%order == 2 .and. abs(self%m(i))*(self%t(n) - self%t(1)) <= 1.0e-6_wp*scale) list(i)%order = 3
      end do
    case default
      allocate (list(0))
    end select
  end function history_corners

  !> Corners of what a drive imposes: the accelerations jump two orders below the quantity, one below its rate.
  pure function drive_corners(self, rate) result(list)
    class(history_function), intent(in) :: self
    logical, intent(in) :: rate         !! the history gives the rate of the driven quantity
    type(corner), allocatable :: list(:)
    list = self%corners()
    list%order = max(0, list%order - merge(1, 2, rate))
  end function drive_corners
end module history
