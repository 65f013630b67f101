!> N, Q and end moments of an element, with its largest outer-fibre stress where its section has a shape (input/README.md,
!> 'internal').
module section_sensor
  use kinds, only: wp
  use beam_element, only: deformation_matrix
  use body, only: body_model
  use sensor, only: observation, sensor_model, harmonic_motion
  implicit none (type, external)
  private
  public :: read_element

  !> An element's section forces.
  type, extends(sensor_model), public :: section_sensor_model
    integer :: element = 0
  contains
    procedure :: read => read_section
    procedure :: respond
  end type section_sensor_model

contains

  !> From the deformations of the last evaluation, those of viscoelastic terms included, and of Rayleigh damping.
  subroutine read_section(self, at, x)
    class(section_sensor_model), intent(in) :: self
    type(observation), intent(in) :: at
    real(wp), intent(inout) :: x(:)           !! n q m1 m2 [N], [N m] and, for sections with a shape, s [Pa]
    call read_element(at, self%marker%body, self%element, x)
  end subroutine read_section

  !> The same of any element.
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
    complex(wp), intent(inout) :: x(:)        !! [N], [N m] and [Pa], as in read_section
    complex(wp) :: d(3), a(6), fibre(4)
    real(wp) :: b(3, 6)
    integer :: i
    associate (body => at%m%s%bodies(self%marker%body), e => self%element, &
               g => at%m%s%bodies(self%marker%body)%elements(self%element))
      i = at%m%s%qo(self%marker%body) + 3
      a = nodal(body, e, motion%x(i + 1:i + body%nf))
      b = deformation_matrix(g)
      d = g%ray_k*motion%s*matmul(b, a) + (1 + element_ratio(body, e, motion%s))* &
          matmul(tangent(body, e, at%y(i + 1:i + body%nf), b), a)
      x(1:4) = section_forces(body, e, d)
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
    complex(wp) :: n, m1, m2
    associate (g => b%elements(e))
      n = 0.0_wp
      if (b%axial) n = g%ea_l*d(1)
      m1 = g%ei_l*(4*d(2) + 2*d(3))
      m2 = g%ei_l*(2*d(2) + 4*d(3))
      x = [n, -(m1 + m2)/g%length, -m1, m2]
    end associate
  end function section_forces

  !> Nodal coordinates of an element from elastic coordinates (6).
  pure function element_coordinates(b, e, qf) result(a)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: qf(:)             !! (nf) [m, rad]
    real(wp) :: a(6)                          !! [m, rad]
    a(1:3) = b%displacement(b%en(1, e), qf)
    a(4:6) = b%displacement(b%en(2, e), qf)
  end function element_coordinates

  !> The same of complex amplitudes.
  pure function nodal(b, e, x) result(a)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    complex(wp), intent(in) :: x(:)           !! (nf) [m, rad]
    complex(wp) :: a(6)                       !! [m, rad]
    a = cmplx(element_coordinates(b, e, real(x, wp)), element_coordinates(b, e, aimag(x)), wp)
  end function nodal

  !> Deformations from nodal coordinates at the present deflection (theory.md, section 4).
  pure function tangent(body, e, q, b) result(t)
    type(body_model), intent(in) :: body
    integer, intent(in) :: e                  !! element
    real(wp), intent(in) :: q(:)              !! (nf) present coordinates [m, rad]
    real(wp), intent(in) :: b(3, 6)           !! at zero deflection [-], [1/m]
    real(wp) :: t(3, 6), p(3), psi(6), l
    t = b
    if (.not. body%stiffening) return
    l = body%elements(e)%length
    psi = [body%elements(e)%s, -body%elements(e)%c, 0.0_wp, -body%elements(e)%s, body%elements(e)%c, 0.0_wp]/l
    p(1) = dot_product(psi, element_coordinates(body, e, q))
    p(2:3) = matmul(b(2:3, :), element_coordinates(body, e, q))
    t(1, :) = b(1, :) + l*(p(1)*psi + ((4*p(2) - p(3))*b(2, :) + (4*p(3) - p(2))*b(3, :))/30)
  end function tangent

  !> E(s)/E_R - 1 of an element's material.
  pure function element_ratio(body, e, s) result(g)
    type(body_model), intent(in) :: body
    integer, intent(in) :: e                  !! element
    complex(wp), intent(in) :: s              !! [1/s]
    complex(wp) :: g                          !! [-]
    integer :: r
    g = 0.0_wp
    do r = 1, size(body%segments)
      if (body%segments(r)%material == body%elements(e)%material) g = body%segments(r)%law%ratio(s)
    end do
  end function element_ratio
end module section_sensor
