!> Sensors of the linearised mechanism: complex amplitudes of every column for a harmonic motion x exp(s t) with multipliers
!> lambda exp(s t). Vectors are resolved in global axes as they stand at the present state; where a body turns, velocities
!> and accelerations contain the turn of its axes.
module linear_sensors
  use kinds, only: wp
  use beam_element, only: deformation_matrix
  use body, only: body_model
  use constraint, only: place_stiffness
  use mechanism, only: mechanism_model
  use place, only: place_model
  use sensors, only: sensor_list
  implicit none (type, external)
  private
  public :: read_linear_sensors

contains

  !> Amplitudes of all columns. m holds the evaluation of the present state; list has read it.
  subroutine read_linear_sensors(list, m, q, v, s, x, lambda, values)
    type(sensor_list), intent(in) :: list
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:), v(:)            !! (nq) present state [m, rad], [m/s, rad/s]
    complex(wp), intent(in) :: s                  !! [1/s]
    complex(wp), intent(in) :: x(:)               !! (nq) unknowns of the linearisation [m, rad]
    complex(wp), intent(in) :: lambda(:)          !! (rows) multipliers [N]
    complex(wp), intent(out) :: values(:)         !! (columns) [unit of each column]
    complex(wp) :: w(3)
    integer :: k, b, i
    do k = 1, size(list%records)
      associate (r => list%records(k), y => values(list%first(k):))
        b = r%place%body
        i = 0
        if (b > 0) i = m%s%qo(b)
        w = place_motion(m, list%places(k), list%p%rho(:, k), x)
        select case (r%quantity)
        case ('position')
          y(1:2) = to_global(m, b, w)
        case ('velocity')
          y(1:2) = to_global(m, b, [velocity(m, b, v, s, w), w(3)])
        case ('acceleration')
          y(1:2) = to_global(m, b, [acceleration(m, b, v, s, w), w(3)])
        case ('angle')
          y(1) = w(3)
        case ('angular_velocity')
          y(1) = s*w(3)
        case ('angular_acceleration')
          y(1) = s**2*w(3)
        case ('deflection')
          y(1:3) = elastic_motion(m, list%places(k), x)
        case ('coordinate')
          y(1:3) = x(i + 3 + r%index)*[(1.0_wp, 0.0_wp), s, s**2]
        case ('reaction')
          y(1:3) = reaction(m, merge(r%joint, m%s%joints + r%drive, r%joint > 0), x, lambda)
        case ('internal')
          associate (bo => m%s%bodies(b))
            call section_forces(bo, r%element, q(i + 4:i + 3 + bo%nf), x(i + 4:i + 3 + bo%nf), s, y)
          end associate
        case default
          call spring_values(m, r%spring, s, x, y)
        end select
      end associate
    end do
  end subroutine read_linear_sensors

  !> Elastic displacement (u, v, rotation) of a place in body axes.
  pure function elastic_motion(m, place, x) result(u)
    type(mechanism_model), intent(in) :: m
    type(place_model), intent(in) :: place
    complex(wp), intent(in) :: x(:)   !! (nq) unknowns of the linearisation [m, rad]
    complex(wp) :: u(3)
    integer :: i, n
    u = 0.0_wp
    if (place%body == 0 .or. place%node == 0) return
    i = m%s%qo(place%body) + 3
    n = m%s%bodies(place%body)%nf
    u = cmplx(m%s%bodies(place%body)%displacement(place%node, real(x(i + 1:i + n), wp)), &
              m%s%bodies(place%body)%displacement(place%node, aimag(x(i + 1:i + n))), wp)
  end function elastic_motion

  !> Displacement of a place in body axes, and of its section's angle.
  pure function place_motion(m, place, rho, x) result(w)
    type(mechanism_model), intent(in) :: m
    type(place_model), intent(in) :: place
    real(wp), intent(in) :: rho(2)                !! its present position in body axes [m]
    complex(wp), intent(in) :: x(:)               !! (nq) unknowns of the linearisation [m, rad]
    complex(wp) :: w(3)
    integer :: i
    w = 0.0_wp
    if (place%body == 0) return
    i = m%s%qo(place%body)
    w = x(i + 1:i + 3) + elastic_motion(m, place, x)
    w(1:2) = w(1:2) + x(i + 3)*[-rho(2), rho(1)]
  end function place_motion

  !> H x: a quarter turn.
  pure function turned(x) result(y)
    complex(wp), intent(in) :: x(:)   !! (nq) unknowns of the linearisation [m, rad]
    complex(wp) :: y(2)
    y = [-x(2), x(1)]
  end function turned

  !> Velocity of a place, resolved in the turning axes of its body: w' + theta' H w.
  pure function velocity(m, b, v, s, w) result(y)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp), intent(in) :: v(:)   !! (nq) present rates [m/s, rad/s]
    complex(wp), intent(in) :: s, w(3)   !! [1/s] and displacement in body axes, turn of the section [m, m, rad]
    complex(wp) :: y(2)
    y = s*w(1:2)
    if (b > 0) y = y + v(m%s%qo(b) + 3)*turned(w)
  end function velocity

  !> Acceleration of a place, resolved likewise: w'' + 2 theta' H w' + theta'' H w - theta'^2 w.
  pure function acceleration(m, b, v, s, w) result(y)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp), intent(in) :: v(:)   !! (nq) present rates [m/s, rad/s]
    complex(wp), intent(in) :: s, w(3)   !! [1/s] and displacement in body axes, turn of the section [m, m, rad]
    complex(wp) :: y(2)
    real(wp) :: rate
    y = s**2*w(1:2)
    if (b == 0) return
    rate = v(m%s%qo(b) + 3)
    y = y + (2*rate*s + m%a(m%s%qo(b) + 3))*turned(w) - rate**2*w(1:2)
  end function acceleration

  !> A vector of a body's axes in global ones.
  pure function to_global(m, b, w) result(y)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    complex(wp), intent(in) :: w(3)   !! vector in body axes, third part unused [any]
    complex(wp) :: y(2)
    y = w(1:2)
    if (b > 0) y = [m%c(b)*w(1) - m%sn(b)*w(2), m%sn(b)*w(1) + m%c(b)*w(2)]
  end function to_global

  !> Displacement of a place of the scene in global axes, and of its section's angle.
  pure function scene_motion(m, k, x) result(y)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k                      !! place
    complex(wp), intent(in) :: x(:)               !! (nq) unknowns of the linearisation [m, rad]
    complex(wp) :: y(3)
    y = place_motion(m, m%s%places(k), m%p%rho(:, k), x)
    y(1:2) = to_global(m, m%s%places(k)%body, y)
  end function scene_motion

  !> Force and moment of a constraint on body a, with the change of its direction.
  function reaction(m, k, x, lambda) result(f)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k                      !! constraint
    complex(wp), intent(in) :: x(:), lambda(:)    !! (nq), (rows) unknowns of the linearisation [m, rad], multipliers [N]
    complex(wp) :: f(3)
    type(place_stiffness) :: t
    integer :: i
    associate (c => m%s%constraints(k)%item)
      call c%geometric(m%p, m%lambda, t)
      f = -matmul(t%k(1:3, 1:3), scene_motion(m, c%ia, x)) - matmul(t%k(1:3, 4:6), scene_motion(m, c%ib, x))
      do i = c%first, c%first + c%rows - 1
        f = f - [m%rows%na(:, i), m%rows%sa(i)]*lambda(i)
      end do
    end associate
  end function reaction

  !> Force and deformation of a spring.
  subroutine spring_values(m, k, s, x, y)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    complex(wp), intent(in) :: s, x(:)   !! [1/s], (nq) unknowns of the linearisation [m, rad]
    complex(wp), intent(inout) :: y(:)   !! force and deformation [N, m] or [N m, rad]
    complex(wp) :: gap(3), d
    real(wp) :: length, rate, e(3)
    associate (sp => m%s%forces(k)%item)
      gap = scene_motion(m, sp%ia, x) - scene_motion(m, sp%ib, x)
      call sp%deformation(m%p, length, rate, e)
      d = sum(e*gap)
      y(1) = (sp%stiffness*(1 + sp%law%ratio(s)) + s*sp%damping)*d
      y(2) = d
    end associate
  end subroutine spring_values

  !> N, Q and end moments of an element, and the stress of the outer fibre where its amplitude is largest.
  pure subroutine section_forces(bo, e, q, x, s, y)
    type(body_model), intent(in) :: bo
    integer, intent(in) :: e                      !! element
    real(wp), intent(in) :: q(:)                  !! (nf) present coordinates [m, rad]
    complex(wp), intent(in) :: x(:), s            !! (nf) amplitudes of the same [m, rad], [1/s]
    complex(wp), intent(inout) :: y(:)            !! n, q, m1, m2 [N, N m]; for sections with a shape, s [Pa]
    complex(wp) :: d(3), a(6), n, m1, m2, fibre(4)
    real(wp) :: b(3, 6)
    associate (g => bo%elements(e))
      a = nodal(bo, e, x)
      b = deformation_matrix(g)
      d = g%ray_k*s*matmul(b, a) + (1 + element_ratio(bo, e, s))*matmul(tangent(bo, e, q, b), a)
      n = 0.0_wp
      if (bo%axial) n = g%ea_l*d(1)
      m1 = g%ei_l*(4*d(2) + 2*d(3))
      m2 = g%ei_l*(2*d(2) + 4*d(3))
      y(1:4) = [n, -(m1 + m2)/g%length, -m1, m2]
      if (.not. bo%fibre(e) > 0.0_wp) return
      fibre = n/bo%area(e) + [m1, -m1, m2, -m2]*bo%fibre(e)/bo%second(e)
      y(5) = fibre(maxloc(abs(fibre), 1))
    end associate
  end subroutine section_forces

  !> Nodal coordinates of an element.
  pure function nodal(bo, e, x) result(a)
    type(body_model), intent(in) :: bo
    integer, intent(in) :: e
    complex(wp), intent(in) :: x(:)   !! (nf) elastic coordinates [m, rad]
    complex(wp) :: a(6)
    integer :: k
    do k = 1, 2
      a(3*k - 2:3*k) = cmplx(bo%displacement(bo%en(k, e), real(x, wp)), bo%displacement(bo%en(k, e), aimag(x)), wp)
    end do
  end function nodal

  !> Deformations from nodal coordinates at the present deflection (theory.md, section 4).
  pure function tangent(bo, e, q, b) result(t)
    type(body_model), intent(in) :: bo
    integer, intent(in) :: e
    real(wp), intent(in) :: q(:), b(3, 6)   !! (nf) present coordinates [m, rad]; deformations per nodal coordinate [-], [1/m]
    real(wp) :: t(3, 6), p(3), psi(6), l
    t = b
    if (.not. bo%stiffening) return
    l = bo%elements(e)%length
    psi = [bo%elements(e)%s, -bo%elements(e)%c, 0.0_wp, -bo%elements(e)%s, bo%elements(e)%c, 0.0_wp]/l
    p(1) = dot_product(psi, real(nodal(bo, e, cmplx(q, 0.0_wp, wp)), wp))
    p(2:3) = matmul(b(2:3, :), real(nodal(bo, e, cmplx(q, 0.0_wp, wp)), wp))
    t(1, :) = b(1, :) + l*(p(1)*psi + ((4*p(2) - p(3))*b(2, :) + (4*p(3) - p(2))*b(3, :))/30)
  end function tangent

  !> E(s)/E_R - 1 of an element's material.
  pure function element_ratio(bo, e, s) result(g)
    type(body_model), intent(in) :: bo
    integer, intent(in) :: e
    complex(wp), intent(in) :: s   !! [1/s]
    complex(wp) :: g
    integer :: r
    g = 0.0_wp
    do r = 1, size(bo%runs)
      if (bo%modal) then
        if (bo%runs(r)%material /= bo%material(e)) cycle
      else
        if (e < bo%runs(r)%first .or. e > bo%runs(r)%last) cycle
      end if
      g = g + bo%runs(r)%law%ratio(s)
    end do
  end function element_ratio
end module linear_sensors
