!> Groups of unknowns that share a scale (input/README.md, &transient tolerance): in each body its translations, its angle,
!> deflections, nodal rotations, internal variables of extensions and of rotations, and the rates of each; modes and springs
!> have groups of their own. Energies are not measured: they follow the motion.
module error_groups
  use kinds, only: wp
  use scene_model, only: scene
  use step_control, only: error_norm, least_scale
  implicit none (type, external)
  private
  public :: group_unknowns, fastest_growth, out_of_shape

  real(wp), parameter :: absurd = 1.0e3_wp/least_scale   !! deflection, rotation that no beam theory knows, of the floor [-]
  real(wp), parameter :: most_angle = 1.0e12_wp     !! of a frame: its sine then has four digits left [rad]
  integer, parameter :: translation = 1, angle = 2, deflection = 3, rotation = 4, extension = 5, bending = 6
  integer, parameter :: kinds_of_group = 6     !! each with the group of its rates behind it

contains

  !> The error norm of a scene.
  subroutine group_unknowns(s, norm)
    type(scene), intent(in) :: s
    type(error_norm), intent(out) :: norm
    integer :: b, k, n
    n = 2*kinds_of_group*size(s%bodies) + 2*size(s%forces) + 2*sum(s%controllers%states)
    allocate (norm%group(s%ny), source=0)
    allocate (norm%floor(n), source=least_scale*s%size)
    allocate (norm%bound(n), source=huge(1.0_wp))
    allocate (norm%rate(n), norm%slope(n), norm%steady(n), source=.false.)
    allocate (norm%largest(n), norm%scale(n), norm%steepest(n), norm%noise(n), source=0.0_wp)
    norm%rate(2:n:2) = .true.
    do b = 1, size(s%bodies)
      norm%slope([(number(b, k), k=translation, rotation)] + 1) = .true.   ! accelerations of frames and elastic coordinates
      call group_body(s, b, norm)
      associate (x => [number(b, deflection), number(b, rotation)])
        norm%bound(x) = absurd*norm%floor(x)
      end associate
      norm%bound(number(b, angle)) = most_angle
      norm%steady([number(b, translation), number(b, angle)]) = .true.
    end do
    do k = 1, size(s%forces)
      n = 2*(kinds_of_group*size(s%bodies) + k) - 1
      associate (f => s%forces(k)%item)
        if (f%angular) norm%floor(n:n + 1) = least_scale
        call assign(s, norm, n, 0, f%offset + 1, f%offset + f%law%second)
        call assign(s, norm, n, 0, f%first_order + 1, f%first_order + f%law%first)
      end associate
    end do
    n = 2*(kinds_of_group*size(s%bodies) + size(s%forces)) + 1
    do k = 1, size(s%controllers)              ! each of their states is of a size of its own
      associate (c => s%controllers(k))
        do b = 1, c%states
          norm%floor(n) = least_scale*c%size_of(b, merge(1.0_wp, s%size, c%quantity%angular))
          call assign(s, norm, n, 0, c%first + b, c%first + b)
          n = n + 2
        end do
      end associate
    end do
  end subroutine group_unknowns

  !> Puts coordinates first..last and their rates into a group and the next one; internal variables where offset = 0.
  subroutine assign(s, norm, group, offset, first, last)
    type(scene), intent(in) :: s
    type(error_norm), intent(inout) :: norm
    integer, intent(in) :: group, offset       !! group of the values; 1: frame or elastic coordinates
    integer, intent(in) :: first, last
    integer :: o, n
    o = merge(0, 2*s%nq, offset == 1)
    n = merge(s%nq, s%nz, offset == 1)
    norm%group(o + first:o + last) = group
    if (offset == 1 .or. first <= s%nzd) norm%group(o + n + first:o + n + last) = group + 1
  end subroutine assign

  !> The groups of one body.
  subroutine group_body(s, b, norm)
    type(scene), intent(in) :: s
    integer, intent(in) :: b
    type(error_norm), intent(inout) :: norm
    integer :: i, k, r, o, j, place
    i = s%qo(b)
    associate (body => s%bodies(b))
      call floors(number(b, angle), least_scale)
      call floors(number(b, rotation), least_scale)
      call floors(number(b, bending), least_scale)
      call assign(s, norm, number(b, translation), 1, i + 1, i + 2)
      call assign(s, norm, number(b, angle), 1, i + 3, i + 3)
      if (.not. body%flexible) return
      call floors(number(b, deflection), least_scale*s%size/body%basis%unit)
      call floors(number(b, extension), least_scale*s%size/body%basis%unit)
      do k = 1, body%nf
        call assign(s, norm, number(b, merge(rotation, deflection, body%basis%rotation(k))), 1, i + 3 + k, i + 3 + k)
      end do
      do r = 1, size(body%segments)
        do k = 1, size(body%segments(r)%law%alpha)
          do j = 1, body%segments(r)%width
            o = body%segments(r)%start(k) + j
            place = 1 + mod((body%segments(r)%first - 1)*body%basis%rows + j - 1, size(body%basis%angle))
            call assign(s, norm, number(b, merge(bending, extension, body%basis%angle(place))), 0, o, o)
          end do
        end do
      end do
    end associate
  contains
    !> Sets the floor of a group and of its rates.
    subroutine floors(group, x)
      integer, intent(in) :: group
      real(wp), intent(in) :: x                !! [m], [rad] or [m kg**(1/2)]
      norm%floor(group:group + 1) = x
    end subroutine floors
  end subroutine group_body

  !> Number of a body's group of values.
  pure integer function number(b, kind) result(group)
    integer, intent(in) :: b, kind
    group = 2*kinds_of_group*(b - 1) + 2*kind - 1
  end function number

  !> The body whose unknowns exceed most what they have been, in a state that was given up; 0: none, or a spring.
  pure function fastest_growth(norm, bodies, y) result(body)
    type(error_norm), intent(in) :: norm
    integer, intent(in) :: bodies
    real(wp), intent(in) :: y(:)               !! (n) the state given up [m, rad], [m/s, rad/s], [J]
    integer :: body, k, g
    real(wp) :: growth, worst
    body = 0
    worst = 0.0_wp
    do k = 1, size(y)
      g = norm%group(k)
      if (g == 0 .or. g > 2*kinds_of_group*bodies) cycle
      growth = huge(1.0_wp)
      if (abs(y(k)) <= 1.0e200_wp) growth = abs(y(k))/max(norm%largest(g), norm%floor(g))
      if (growth <= worst) cycle
      worst = growth
      body = 1 + (g - 1)/(2*kinds_of_group)
    end do
  end function fastest_growth

  !> The first body that has deflected beyond all sense, so that the solution grows without bound; 0: none.
  pure integer function out_of_shape(norm, bodies) result(body)
    type(error_norm), intent(in) :: norm
    integer, intent(in) :: bodies
    do body = 1, bodies
      associate (x => [number(body, deflection), number(body, rotation)])
        if (any(norm%largest(x) > norm%bound(x))) return
      end associate
    end do
    body = 0
  end function out_of_shape
end module error_groups
