!> N, Q and end moments of an element, its largest outer-fibre stress where its section has a shape (input/README.md, 'internal'),
!> and the largest stress of a body. Within an element the axial force is constant and the moment linear, so that the stress is
!> largest at one of its ends.
module section_sensors
  use kinds, only: wp
  use beam_element, only: deformation_law, deformation_matrix, present_deformation_matrix
  use body, only: body_model
  use sensor, only: nonlinear_sensor, observation, sensor_model, harmonic_motion
  implicit none (type, external)
  private

  !> An element's section forces.
  type, extends(sensor_model), public :: section_sensor_model
    integer :: element = 0
  contains
    procedure :: read => read_section
    procedure :: respond
  end type section_sensor_model

  !> A body's largest stress over the elements whose sections have a shape, and its place: the element and its node.
  type, extends(nonlinear_sensor), public :: stress_sensor_model
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
    real(wp) :: d(3)
    integer :: i
    associate (b => at%m%s%bodies(body), g => at%m%s%bodies(body)%elements(e))
      d = b%basis%element_strain(b, e, at%ev%elastic(body))
      i = at%m%s%nq + at%m%s%qo(body) + 3
      if (b%rayleigh) d = d + g%ray_k*matmul(deformation_matrix(g), element_coordinates(b, e, at%y(i + 1:i + b%nf)))
      x(1:4) = real(section_forces(b, e, cmplx(d, kind=wp)))
      if (g%fibre > 0.0_wp) x(5) = abs(x(1))/g%area + maxval(abs(x(3:4)))*g%fibre/g%second
    end associate
  end subroutine read_element

  !> With the material's modulus at s; the stress is that of the outer fibre where its amplitude is largest.
  subroutine respond(self, at, motion, x)
    class(section_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp), intent(inout) :: x(:)        !! as read_section [N], [N m], [Pa]
    complex(wp) :: a(6), fibre(4)
    real(wp) :: b(3, 6)
    integer :: i
    associate (body => at%m%s%bodies(self%marker%body), e => self%element, &
               g => at%m%s%bodies(self%marker%body)%elements(self%element))
      i = at%m%s%qo(self%marker%body) + 3
      a = cmplx(element_coordinates(body, e, real(motion%x(i + 1:i + body%nf), wp)), &
                element_coordinates(body, e, aimag(motion%x(i + 1:i + body%nf))), wp)
      b = deformation_matrix(g)
      if (body%stiffening) b = present_deformation_matrix(g, element_coordinates(body, e, at%y(i + 1:i + body%nf)))
      x(1:4) = section_forces(body, e, g%ray_k*motion%s*matmul(deformation_matrix(g), a) &
                              + (1 + element_ratio(body, e, motion%s))*matmul(b, a))
      if (.not. g%fibre > 0.0_wp) return
      fibre = x(1)/g%area + [x(3), -x(3), x(4), -x(4)]*g%fibre/g%second
      x(5) = fibre(maxloc(abs(fibre), 1))
    end associate
  end subroutine respond

  !> N, Q and the end moments from an element's deformations.
  pure function section_forces(b, e, d) result(x)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    complex(wp), intent(in) :: d(3)           !! stretch [m], turns of its ends [rad]
    complex(wp) :: x(4)                       !! [N], [N m]
    complex(wp) :: f(3)                       ! [N], [N m]
    f = matmul(deformation_law(b%elements(e)), d)
    if (.not. b%axial) f(1) = 0.0_wp
    x = [f(1), -(f(2) + f(3))/b%elements(e)%length, -f(2), f(3)]
  end function section_forces

  !> Nodal coordinates of an element from elastic coordinates.
  pure function element_coordinates(b, e, qf) result(a)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: qf(:)             !! (nf) [m, rad]
    real(wp) :: a(6)                          !! [m, rad]
    a(1:3) = b%displacement(b%en(1, e), qf)
    a(4:6) = b%displacement(b%en(2, e), qf)
  end function element_coordinates

  !> E(s)/E_R - 1 of an element's material.
  pure complex(wp) function element_ratio(body, e, s) result(g)   ! [-]
    type(body_model), intent(in) :: body
    integer, intent(in) :: e                  !! element
    complex(wp), intent(in) :: s              !! [1/s]
    integer :: r
    g = 0.0_wp
    do r = 1, size(body%segments)
      if (body%segments(r)%material == body%elements(e)%material) g = body%segments(r)%law%ratio(s)
    end do
  end function element_ratio
end module section_sensors
