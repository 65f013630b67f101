!> N, Q and end moments of an element, its largest outer-fibre stress where its section has a shape (input/README.md, 'internal'),
!> and the largest stress of a body. Within an element the axial force is constant and the moment linear, so that the stress is
!> largest at one of its ends.
module section_sensors
  use kinds, only: wp
  use body, only: body_model
  use element_law, only: forces_of, rows_of
  use sensor, only: observation, sensor_model, harmonic_motion
  implicit none (type, external)
  private
  public :: present_rows, row_amplitudes

  !> An element's section forces.
  type, extends(sensor_model), public :: section_sensor_model
    integer :: element = 0
  contains
    procedure :: read => read_section
    procedure :: respond
  end type section_sensor_model

  !> A body's largest stress over the elements whose sections have a shape, and its place: the element and its node.
  type, extends(sensor_model), public :: stress_sensor_model
  contains
    procedure :: read => read_stress
  end type stress_sensor_model

contains

  !> As evaluated.
  subroutine read_section(self, at, x)
    class(section_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! n q m1 m2 [N], [N m] and, for sections with a shape, s [Pa]
    call read_element(at, self%marker%body, self%element, x)
  end subroutine read_section

  !> As evaluated.
  subroutine read_stress(self, at, x)
    class(stress_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! [Pa], [-], [-]
    real(wp) :: found(5)
    integer :: e
    x(1:3) = 0.0_wp
    associate (body => at%m%s%bodies(self%marker%body))
      do e = 1, size(body%elements)
        found(5) = 0.0_wp
        call read_element(at, self%marker%body, e, found)
        if (e > 1 .and. .not. found(5) > x(1)) cycle
        x(1:3) = [found(5), real([e, body%en(merge(1, 2, abs(found(3)) >= abs(found(4))), e)], wp)]
      end do
    end associate
  end subroutine read_stress

  !> Of one element, from the deformations of the last evaluation, those of viscoelastic terms included, and of Rayleigh damping.
  subroutine read_element(at, body, e, x)
    type(observation), intent(in) :: at
    integer, intent(in) :: body               !! number of its body
    integer, intent(in) :: e                  !! element
    real(wp), intent(inout) :: x(:)           !! n q m1 m2 [N], [N m] and, for sections with a shape, s [Pa]
    associate (b => at%m%s%bodies(body), g => at%m%s%bodies(body)%elements(e))
      x(1:4) = real(section_forces(b, e, cmplx(present_rows(at, body, e), kind=wp)))
      if (g%fibre > 0.0_wp) x(5) = abs(x(1))/g%area + maxval(abs(x(3:4)))*g%fibre/g%second
    end associate
  end subroutine read_element

  !> Rows of an element's deformations in the last evaluation, with the terms' differences and those of Rayleigh damping.
  function present_rows(at, body, e) result(d)
    type(observation), intent(in) :: at
    integer, intent(in) :: body               !! number of its body
    integer, intent(in) :: e                  !! element
    real(wp), allocatable :: d(:)             !! [m, rad]
    integer :: i
    associate (b => at%m%s%bodies(body))
      d = b%basis%element_strain(b, e, at%ev%elastic(body))
      i = at%m%s%nq + at%m%s%qo(body) + 3
      if (b%rayleigh) d = d + b%layers%kinds(b%layers%kind(e))%ray_k &
                          *rows_of(b, e, b%basis%element_coordinates(b, e, at%y(i + 1:i + b%nf)))
    end associate
  end function present_rows

  !> With the material's modulus at s; the stress is that of the outer fibre where its amplitude is largest.
  subroutine respond(self, at, motion, x)
    class(section_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! as read_section [N], [N m], [Pa]
    complex(wp) :: fibre(4)
    associate (body => at%m%s%bodies(self%marker%body), e => self%element, &
               g => at%m%s%bodies(self%marker%body)%elements(self%element))
      x(1:4) = section_forces(body, e, row_amplitudes(at, motion, self%marker%body, e))
      if (.not. g%fibre > 0.0_wp) return
      fibre = x(1)/g%area + [x(3), -x(3), x(4), -x(4)]*g%fibre/g%second
      x(5) = fibre(maxloc(abs(fibre), 1))
    end associate
  end subroutine respond

  !> Amplitudes of an element's rows, with each material's modulus at s and Rayleigh damping; with stiffening about the present
  !> state.
  function row_amplitudes(at, motion, body, e) result(d)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    integer, intent(in) :: body               !! number of its body
    integer, intent(in) :: e                  !! element
    complex(wp), allocatable :: d(:)          !! [m, rad]
    complex(wp), allocatable :: rate(:)       ! [m/s, rad/s]
    complex(wp) :: factor                     ! E(s)/E_R of a material [-]
    integer, allocatable :: material(:)
    integer :: i, r, k
    i = at%m%s%qo(body) + 3
    associate (b => at%m%s%bodies(body))
      associate (re => b%basis%element_coordinates(b, e, real(motion%x(i + 1:i + b%nf), wp)), &
                 im => b%basis%element_coordinates(b, e, aimag(motion%x(i + 1:i + b%nf))))
        d = cmplx(rows_of(b, e, re), rows_of(b, e, im), wp)
        if (b%rayleigh) rate = motion%s*d
        if (b%stiffening) then
          associate (now => b%basis%element_coordinates(b, e, at%y(i + 1:i + b%nf)))
            d = cmplx(rows_of(b, e, re, now), rows_of(b, e, im, now), wp)
          end associate
        end if
      end associate
      material = b%layers%kinds(b%layers%kind(e))%material
      do r = 1, size(b%segments)
        if (.not. any(material == b%segments(r)%material)) cycle
        factor = 1 + b%segments(r)%law%ratio(motion%s)
        do k = 1, size(d)
          if (material(k) == b%segments(r)%material) then
            d(k) = factor*d(k)
            material(k) = 0                  ! other segments have the material, too
          end if
        end do
      end do
      if (b%rayleigh) d = d + b%layers%kinds(b%layers%kind(e))%ray_k*rate
    end associate
  end function row_amplitudes

  !> N, Q and the end moments from an element's rows.
  pure function section_forces(b, e, d) result(x)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    complex(wp), intent(in) :: d(:)           !! rows [m, rad]
    complex(wp) :: x(4)                       !! [N], [N m]
    complex(wp) :: f(3)                       ! [N], [N m]
    f = forces_of(b, e, d)
    x = [f(1), -(f(2) + f(3))/b%elements(e)%length, -f(2), f(3)]
  end function section_forces
end module section_sensors
