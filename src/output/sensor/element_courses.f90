!> Section forces along an element in an evaluated state, and their amplitudes in the linear response (theory.md, section 18).
module element_courses
  use kinds, only: half_digits, wp
  use body, only: body_model
  use body_tangents, only: find_wrenches, frame_acceleration
  use constraint, only: marker_stiffness
  use controller, only: free
  use element_law, only: forces_of, rows_of
  use evaluation_results, only: conditions_of
  use force_element, only: stage_static
  use layered_element, only: most_coordinates
  use marker, only: turn
  use modal_basis, only: modal_model
  use section_forces, only: add_courses, course_of_deformation, course_of_loads, course_of_pull, element_axes, element_motion, &
                            resultant_of_loads, section_course
  use sensor, only: harmonic_motion, marker_moves, observation, pair_motion, quantity_amplitude
  use sorting, only: ascending
  implicit none (type, external)
  private
  public :: balanced, course_amplitudes, outer_amplitudes, outer_forces, part, present_course

  !> Section forces of an element, and the part that its deformation asks for.
  type, public :: element_course
    type(section_course) :: all
    type(section_course) :: elastic
    real(wp) :: lean(2) = 0.0_wp              !! what the axial force adds to Q of the turned sections at both ends [N]
    complex(wp), allocatable :: rows(:)       !! of the deformation, with viscoelastic terms and Rayleigh damping [m, rad]
  end type element_course

contains

  !> Whether no coordinate of a straight body stretches it: its axial force is that of equilibrium, of a rigid one all section
  !> forces are.
  pure logical function balanced(b)
    type(body_model), intent(in) :: b
    real(wp) :: a(most_coordinates), moved, stretched   ! of all modes [kg^-.5]
    integer :: e, k
    balanced = .not. (b%flexible .and. b%axial)
    if (balanced) return
    select type (basis => b%basis)
    type is (modal_model)
      if (any(abs(b%elements%c*b%elements(1)%s - b%elements%s*b%elements(1)%c) > half_digits)) return
      moved = 0.0_wp
      stretched = 0.0_wp
      do e = 1, b%ne
        do k = 1, b%nf
          a = element_axes(b, e, basis%psi(b%edof(:, e), k))
          moved = max(moved, abs(a(2)), abs(a(5)))
          stretched = max(stretched, abs(a(4) - a(1)))
        end do
      end do
      balanced = stretched <= half_digits*moved
    end select
  end function balanced

  !> In the last evaluation.
  function present_course(at, body, e, outer) result(x)
    type(observation), intent(in) :: at
    integer, intent(in) :: body               !! number of the body
    integer, intent(in) :: e                  !! element
    real(wp), intent(in), optional :: outer(3)   !! forces at its first end, where they are those of equilibrium [N], [N m]
    type(element_course) :: x
    type(element_motion) :: motion
    type(section_course) :: summed
    real(wp) :: f(3)                          ! [N], [N m]
    motion = present_motion(at, body, e)
    associate (b => at%m%s%bodies(body))
      if (present(outer)) summed = course_of_loads(b, e, motion, outer)
      if (b%flexible) then
        x%rows = cmplx(present_rows(at, body, e), kind=wp)
        f = real(forces_of(b, e, x%rows))
        x%elastic = course_of_deformation(b%elements(e)%length, f)
        x%all = add_courses(x%elastic, course_of_loads(b, e, motion))
        if (b%stiffening) x%all = add_courses(x%all, course_of_pull(b, e, pull_of(b, e, cmplx(b%basis%element_strain( &
          b, e, at%ev%elastic(body)), kind=wp), 1), motion%q))
        if (present(outer)) x%all%n = summed%n
        if (b%stiffening) x%lean = -[x%all%n(0), sum(x%all%n)]*motion%q([3, 6])
      else
        x%all = summed
      end if
    end associate
  end function present_course

  !> Real and imaginary parts of the amplitudes about the present state, with each material's modulus at s.
  function course_amplitudes(at, motion, body, e, outer) result(x)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    integer, intent(in) :: body               !! number of the body
    integer, intent(in) :: e                  !! element
    real(wp), intent(in), optional :: outer(:, :)   !! (3, parts) at its first end, if they are those of equilibrium [N], [N m]
    type(element_course) :: x(2), still
    type(element_motion) :: change(2), now
    type(section_course) :: summed
    complex(wp) :: f(3)                       ! [N], [N m]
    integer :: k
    associate (b => at%m%s%bodies(body))
      if (b%stiffening) still = present_course(at, body, e)
      now = present_motion(at, body, e)
      do k = 1, 2
        change = change_of_motion(at, motion, body, e, k)
        if (present(outer)) summed = add_courses(course_of_loads(b, e, change(1), outer(:, k)), &
                                                 course_of_loads(b, e, change(2), [0.0_wp, 0.0_wp, 0.0_wp]))
        x(k)%all = summed
        if (.not. b%flexible) cycle
        x(k)%rows = row_amplitudes(at, motion, body, e, b%rayleigh)
        f = forces_of(b, e, x(k)%rows)
        if (present(outer)) f(1) = 0.0_wp
        x(k)%elastic = course_of_deformation(b%elements(e)%length, part(f, k))
        x(k)%all = add_courses(x(k)%elastic, add_courses(course_of_loads(b, e, change(1)), course_of_loads(b, e, change(2))))
        if (present(outer)) x(k)%all%n = summed%n
        if (.not. b%stiffening) cycle
        x(k)%all = add_courses(x(k)%all, add_courses( &
          course_of_pull(b, e, pull_of(b, e, row_amplitudes(at, motion, body, e, .false.), k), now%q), &
          course_of_pull(b, e, pull_of(b, e, cmplx(b%basis%element_strain(b, e, at%ev%elastic(body)), kind=wp), 1), change(2)%q)))
        x(k)%lean = -[x(k)%all%n(0), sum(x(k)%all%n)]*now%q([3, 6]) - [still%all%n(0), sum(still%all%n)]*change(2)%q([3, 6])
      end do
    end associate
  end function course_amplitudes

  !> The real or imaginary part of how an element's motion changes: by that of its frame, and in its frame. Loads are linear in both
  !> of them.
  function change_of_motion(at, motion, body, e, k) result(change)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    integer, intent(in) :: body               !! number of the body
    integer, intent(in) :: e                  !! element
    integer, intent(in) :: k                  !! 1: real part, 2: imaginary part
    type(element_motion) :: change(2)
    complex(wp) :: w(most_coordinates)        ! coordinates of the element [m, rad]
    real(wp) :: rate                          ! [rad/s]
    integer :: i
    i = at%m%s%qo(body)
    rate = at%y(at%m%s%nq + i + 3)
    change = present_motion(at, body, e)
    associate (s => motion%s, frame => motion%x(i + 1:i + 3), b => at%m%s%bodies(body), now => change(2)%a)
      change(1)%a = part(s**2*frame(1:2) - frame(3)*turn(now), k)
      change(1)%turn = part(s**2*frame(3), k)
      change(1)%coriolis = part(2*s*frame(3), k)
      change(1)%centrifugal = part(2*rate*s*frame(3), k)
      change(1)%damped = 0.0_wp
      change(1)%acceleration = 0.0_wp
      change(2)%a = 0.0_wp
      change(2)%place = 0.0_wp
      if (.not. b%flexible) return
      w = amplitudes_of(b, e, motion%x(i + 4:i + 3 + b%nf))
      change(2)%q = part(w, k)
      change(2)%v = part(s*w, k)
      change(2)%damped = change(2)%v
      change(2)%acceleration = part(s**2*w, k)
    end associate
  end function change_of_motion

  !> Axial force that acts along the deflected element: that of Rayleigh damping is linear, and does not.
  pure real(wp) function pull_of(b, e, rows, k)   ! [N]
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    complex(wp), intent(in) :: rows(:)        !! without Rayleigh damping [m, rad]
    integer, intent(in) :: k                  !! 1: real part, 2: imaginary part
    complex(wp) :: f(3)                       ! [N], [N m]
    f = forces_of(b, e, rows)
    pull_of = part(f(1), k)
  end function pull_of

  !> The real part, or the imaginary one.
  elemental real(wp) function part(x, k)      ! [any]
    complex(wp), intent(in) :: x              !! [any]
    integer, intent(in) :: k                  !! 1 or 2
    part = merge(real(x, wp), aimag(x), k == 1)
  end function part

  !> Element coordinates of amplitudes, element axes.
  pure function amplitudes_of(b, e, x) result(w)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                  !! element
    complex(wp), intent(in) :: x(:)           !! (nf) [m, rad]
    complex(wp) :: w(most_coordinates)        !! [m, rad]
    w = cmplx(element_axes(b, e, b%basis%element_coordinates(b, e, real(x, wp))), &
              element_axes(b, e, b%basis%element_coordinates(b, e, aimag(x))), wp)
  end function amplitudes_of

  !> How an element moves in the last evaluation.
  function present_motion(at, body, e) result(x)
    type(observation), intent(in) :: at
    integer, intent(in) :: body               !! number of the body
    integer, intent(in) :: e                  !! element
    type(element_motion) :: x
    integer :: i, j
    i = at%m%s%qo(body) + 3
    j = at%m%s%nq + i
    x%a = frame_acceleration(at%m, at%ev, body, at%ev%a)
    x%turn = at%ev%a(i)
    x%coriolis = 2*at%y(j)
    x%centrifugal = at%y(j)**2
    associate (b => at%m%s%bodies(body))
      if (b%flexible) then
        x%q = element_axes(b, e, b%basis%element_coordinates(b, e, at%y(i + 1:i + b%nf)))
        x%v = element_axes(b, e, b%basis%element_coordinates(b, e, at%y(j + 1:j + b%nf)))
        x%acceleration = element_axes(b, e, b%basis%element_coordinates(b, e, at%ev%a(i + 1:i + b%nf)))
      end if
      x%damped = x%v
    end associate
  end function present_motion

  !> N, Q and M at the first end of each element of a straight body by what acts beyond it: forces and moments at nodes, weight and
  !> inertia of elements and lumps.
  function outer_forces(at, body) result(outer)
    type(observation), intent(in) :: at
    integer, intent(in) :: body               !! number of the body
    real(wp), allocatable :: outer(:, :)      !! (3, elements) [N], [N m]
    real(wp), allocatable :: wrench(:, :)     ! (3, markers) body axes [N, N, N m]
    real(wp) :: own(3, at%m%s%bodies(body)%ne), node(3, at%m%s%bodies(body)%nn)   ! [N], [N m]
    integer :: k
    allocate (wrench(3, size(at%m%s%markers)))
    call find_wrenches(at%m, at%ev, at%ev%lambda, at%ev%action, wrench)
    node = at_nodes(at, body, -wrench)
    associate (b => at%m%s%bodies(body))
      do k = 1, size(b%lumps)
        associate (n => b%lumps(k)%node)
          node(:, n) = node(:, n) - lump_inertia(at, body, k)
        end associate
      end do
      do k = 1, b%ne
        own(:, k) = resultant_of_loads(b, k, present_motion(at, body, k))
      end do
      outer = beyond(b, node, own)
    end associate
  end function outer_forces

  !> Their amplitudes, real and imaginary parts. A wrench of global axes changes in those of the body as it turns.
  function outer_amplitudes(at, motion, body) result(outer)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    integer, intent(in) :: body               !! number of the body
    real(wp), allocatable :: outer(:, :, :)   !! (3, elements, parts) [N], [N m]
    real(wp) :: wrench(3, size(at%m%s%markers))   ! of the state, body axes, residual [N, N, N m]
    complex(wp) :: change(3, size(at%m%s%markers))   ! likewise, with the sign of what acts
    real(wp) :: own(3, at%m%s%bodies(body)%ne), node(3, at%m%s%bodies(body)%nn)   ! [N], [N m]
    type(element_motion) :: moves(2)
    integer :: e, k, n
    call find_wrenches(at%m, at%ev, at%ev%lambda, at%ev%action, wrench)
    change = wrench_amplitudes(at, motion)
    associate (b => at%m%s%bodies(body), turned => motion%x(at%m%s%qo(body) + 3), c => at%ev%frame%cos(body), &
               s => at%ev%frame%sin(body))
      do n = 1, size(change, 2)
        if (at%m%s%markers(n)%body /= body) cycle
        change(1:2, n) = [c*change(1, n) + s*change(2, n), c*change(2, n) - s*change(1, n)] + turned*turn(wrench(1:2, n))
      end do
      allocate (outer(3, b%ne, 2))
      do k = 1, 2
        node = at_nodes(at, body, part(change, k))
        do n = 1, size(b%lumps)
          node(:, b%lumps(n)%node) = node(:, b%lumps(n)%node) - part(lump_amplitude(at, motion, body, n), k)
        end do
        do e = 1, b%ne
          moves = change_of_motion(at, motion, body, e, k)
          own(:, e) = resultant_of_loads(b, e, moves(1)) + resultant_of_loads(b, e, moves(2))
        end do
        outer(:, :, k) = beyond(b, node, own)
      end do
    end associate
  end function outer_amplitudes

  !> Amplitudes of the wrenches on all markers, global axes: of rows, springs, stops and loads, and of what drives the response.
  function wrench_amplitudes(at, motion) result(w)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    complex(wp) :: w(3, size(at%m%s%markers)) !! [N, N, N m]
    type(marker_stiffness) :: t, slow
    complex(wp) :: f(6), output               ! on both markers [N, N, N m], of a controller [any]
    integer :: k, i, j
    w = 0.0_wp
    associate (s => at%m%s, ev => at%ev)
      do k = 1, size(s%constraints)
        associate (c => s%constraints(k)%item)
          call c%geometric(ev%p, ev%lambda, t)
          f = -matmul(t%k, pair_motion(at, c%ia, c%ib, motion%x))
          do i = c%first, c%first + c%rows - 1
            f = f - [ev%rows%na(:, i), ev%rows%sa(i), ev%rows%nb(:, i), ev%rows%sb(i)]*motion%lambda(i)
          end do
          call add(c%ia, c%ib, f)
        end associate
      end do
      do k = 1, s%acting
        associate (x => s%forces(k)%item, with => conditions_of(at%m, ev, k))
          call x%tangent(ev%p, with, [1.0_wp, 1.0_wp], ev%action(k)%force, t)
          f = -pair_product(t, x%ia, x%ib)
          if (x%law%order() > 0) then
            call x%tangent(ev%p, with, [1.0_wp, 0.0_wp], 0.0_wp, slow)
            f = f - x%law%ratio(motion%s)*pair_product(slow, x%ia, x%ib)
          end if
          if (x%controller > 0) then
            associate (c => s%controllers(x%controller))
              output = c%response(free, motion%s)*quantity_amplitude(at, motion, c%quantity, s%markers, ev%p)
            end associate
            if (x%stage /= stage_static) f(1:3) = f(1:3) + x%unit_wrench(ev%p, with)*output
          else
            do j = 1, x%motions
              call x%argument_tangent(ev%p, conditions_of(at%m, ev, k, j), j, t)
              f = f - pair_product(t, x%arguments(j)%item%ia, x%arguments(j)%item%ib)
            end do
          end if
          i = s%markers(x%ia)%body
          if (x%in_frame .and. i > 0) f(1:2) = f(1:2) + motion%x(s%qo(i) + 3)*turn(ev%action(k)%a(1:2))
          call add(x%ia, x%ib, f)
        end associate
      end do
      if (motion%marker > 0) w(:, motion%marker) = w(:, motion%marker) + motion%wrench
    end associate
  contains
    !> Adds to both markers.
    subroutine add(a, b, f)
      integer, intent(in) :: a, b
      complex(wp), intent(in) :: f(6)         !! [N, N, N m]
      w(:, a) = w(:, a) + f(1:3)
      if (b /= a) w(:, b) = w(:, b) + f(4:6)
    end subroutine add

    !> What a tangent asks for as a pair of markers moves.
    function pair_product(t, a, b) result(f)
      type(marker_stiffness), intent(in) :: t
      integer, intent(in) :: a, b
      complex(wp) :: f(6), place(6), rate(6)  !! [N, N, N m]; [m, rad] and per second
      call marker_moves(at, motion, at%m%s%markers(a), at%ev%p, a, place(1:3), rate(1:3))
      call marker_moves(at, motion, at%m%s%markers(b), at%ev%p, b, place(4:6), rate(4:6))
      f = matmul(t%k, place) + matmul(t%c, rate)
    end function pair_product
  end function wrench_amplitudes

  !> The sum of the wrenches on each node of a body.
  pure function at_nodes(at, body, wrench) result(node)
    type(observation), intent(in) :: at
    integer, intent(in) :: body               !! number of the body
    real(wp), intent(in) :: wrench(:, :)      !! (3, markers) body axes [N, N, N m]
    real(wp) :: node(3, at%m%s%bodies(body)%nn)   !! likewise
    integer :: k
    node = 0.0_wp
    do k = 1, size(wrench, 2)
      associate (p => at%m%s%markers(k))
        if (p%body == body .and. p%node > 0) node(:, p%node) = node(:, p%node) + wrench(:, k)
      end associate
    end do
  end function at_nodes

  !> N, Q and M at the first end of each element by loads at nodes and on elements. Elements may point against the first one where N
  !> alone is asked for.
  pure function beyond(b, at_node, on_element) result(outer)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: at_node(:, :)     !! (3, nodes) body axes [N, N, N m]
    real(wp), intent(in) :: on_element(:, :)  !! (3, elements) element axes, moments about first ends [N, N, N m]
    real(wp) :: outer(3, b%ne)                !! [N], [N m]
    real(wp) :: node(3, b%nn), place(b%nn)    ! along the body [N, N, N m], [m]
    real(wp) :: total(3), own(3)              ! moments about place 0 [N, N, N m]
    integer :: elements(b%ne), nodes(b%nn), k, e, next
    logical :: forwards                       ! the element points as the first one does
    associate (c => b%elements(1)%c, s => b%elements(1)%s)
      node(1:2, :) = matmul(reshape([c, -s, s, c], [2, 2]), at_node(1:2, :))
      node(3, :) = at_node(3, :)
      place = matmul([c, s], b%x)
    end associate
    nodes = ascending(place)
    elements = ascending(place(b%en(1, :)) + place(b%en(2, :)))
    total = 0.0_wp
    next = b%nn
    do k = b%ne, 1, -1
      e = elements(k)
      do while (next > 0)
        if (.not. place(nodes(next)) > 0.5_wp*sum(place(b%en(:, e)))) exit
        total = total + node(:, nodes(next)) + [0.0_wp, 0.0_wp, place(nodes(next))*node(2, nodes(next))]
        next = next - 1
      end do
      forwards = place(b%en(2, e)) > place(b%en(1, e))
      own = on_element(:, e)
      if (.not. forwards) own(1:2) = -own(1:2)
      own(3) = own(3) + place(b%en(1, e))*own(2)
      if (forwards) total = total + own
      outer(:, e) = total - [0.0_wp, 0.0_wp, place(b%en(1, e))*total(2)]
      if (.not. forwards) total = total + own
    end do
  end function beyond

  !> Mass times acceleration less weight of a lump, and what its rotary inertia takes, body axes.
  pure function lump_inertia(at, body, k) result(f)
    type(observation), intent(in) :: at
    integer, intent(in) :: body               !! number of the body
    integer, intent(in) :: k                  !! lump
    real(wp) :: f(3)                          !! [N, N, N m]
    real(wp) :: u(3), v(3), a(3)              ! place and its elastic rates [m, rad] and per second
    integer :: i, j
    i = at%m%s%qo(body) + 3
    j = at%m%s%nq + i
    associate (b => at%m%s%bodies(body), l => at%m%s%bodies(body)%lumps(k), rate => at%y(j), change => at%ev%a(i))
      u = b%displacement(l%node, at%y(i + 1:i + b%nf))
      v = b%displacement(l%node, at%y(j + 1:j + b%nf))
      a = b%displacement(l%node, at%ev%a(i + 1:i + b%nf))
      u(1:2) = u(1:2) + l%x
      f(1:2) = l%mass*(frame_acceleration(at%m, at%ev, body, at%ev%a) + change*turn(u(1:2)) - rate**2*u(1:2) &
                       + 2*rate*turn(v(1:2)) + a(1:2))
      f(3) = l%inertia*(change + a(3))
    end associate
  end function lump_inertia

  !> Its amplitude.
  function lump_amplitude(at, motion, body, k) result(f)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    integer, intent(in) :: body               !! number of the body
    integer, intent(in) :: k                  !! lump
    complex(wp) :: f(3)                       !! body axes [N, N, N m]
    complex(wp) :: w(3)                       ! displacement [m, rad]
    real(wp) :: u(3), still(3), rate, change  ! place [m, rad], [N, N, N m], theta' and theta'' [1/s], [1/s2]
    integer :: i
    still = lump_inertia(at, body, k)
    i = at%m%s%qo(body)
    rate = at%y(at%m%s%nq + i + 3)
    change = at%ev%a(i + 3)
    associate (b => at%m%s%bodies(body), l => at%m%s%bodies(body)%lumps(k), s => motion%s)
      u = b%displacement(l%node, at%y(i + 4:i + 3 + b%nf))
      w = cmplx(b%displacement(l%node, real(motion%x(i + 4:i + 3 + b%nf), wp)), &
                b%displacement(l%node, aimag(motion%x(i + 4:i + 3 + b%nf))), wp)
      w = w + motion%x(i + 1:i + 3)
      w(1:2) = w(1:2) + motion%x(i + 3)*turn(l%x + u(1:2))
      f(1:2) = l%mass*((s**2 - rate**2)*w(1:2) + (2*rate*s + change)*[-w(2), w(1)]) - motion%x(i + 3)*turn(still(1:2))
      f(3) = l%inertia*s**2*w(3)
    end associate
  end function lump_amplitude

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

  !> Amplitudes of an element's rows, with each material's modulus at s, with Rayleigh damping or without; with stiffening about
  !> the present state.
  function row_amplitudes(at, motion, body, e, damped) result(d)
    type(observation), intent(in) :: at
    type(harmonic_motion), intent(in) :: motion
    integer, intent(in) :: body               !! number of its body
    integer, intent(in) :: e                  !! element
    logical, intent(in) :: damped             !! with Rayleigh damping
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
        if (damped) rate = motion%s*d
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
      if (damped) d = d + b%layers%kinds(b%layers%kind(e))%ray_k*rate
    end associate
  end function row_amplitudes
end module element_courses
