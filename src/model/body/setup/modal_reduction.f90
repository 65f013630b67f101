!> Reduces a flexible body to its lowest modes and static shapes (`body_modes`): shape integrals, gyroscopic matrix, damping
!> and the materials' stiffness in the modal basis. Set-up work only.
module modal_reduction
  use kinds, only: half_digits, wp
  use body, only: body_model
  use element_law, only: inertia_of, parts_of, strain_products
  use layered_element, only: element_inertia
  use segment_model, only: viscoelastic_segment
  use sparse_pattern, only: symmetric_pattern
  use body_operators, only: modal_operators
  use body_modes, only: lowest_modes, add_static_shapes
  use elastic_operators, only: elastic_operator, add_product
  use modal_basis, only: modal_model
  implicit none (type, external)
  private
  public :: reduce_to_modes, static_loads

contains

  !> Replaces the nodal coordinates of a body by its `modes` lowest modes and by static shapes: those asked for, and with cores
  !> those of their materials' forces in the modes.
  subroutine reduce_to_modes(b, modes, shapes, loaded, bad)
    type(body_model), intent(inout) :: b                !! with nodal integrals and operators
    integer, intent(in) :: modes                        !! modes kept
    logical, intent(in) :: shapes                       !! whether static shapes are kept, too
    integer, intent(in) :: loaded(:)                    !! nodal coordinates on which forces and moments act
    logical, intent(out) :: bad                         !! the eigenvalue problem failed
    real(wp), allocatable :: x(:, :), w(:), loads(:, :)
    call lowest_modes(b, modes, x, w, bad)
    if (bad) return
    loads = layer_loads(b, x)
    if (shapes) loads = reshape([static_loads(b, loaded), loads], [b%nf, size(loaded) + 4 + size(loads, 2)])
    if (size(loads) > 0) call add_static_shapes(b, loads, x, w, bad)
    if (bad) return
    call project_integrals(b, x, w)
    call set_basis(b, x, w, size(w) - modes)
    b%nf = size(w)
  end subroutine reduce_to_modes

  !> The basis, and what others ask about it.
  pure subroutine set_basis(b, x, w, static_shapes)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: x(:, :)                     !! (nodal, modes) nodal coordinates [m or rad, over kg^.5 m]
    real(wp), intent(in) :: w(:)                        !! (modes) squared frequencies [rad2/s2]
    integer, intent(in) :: static_shapes                !! how many of them are such
    type(modal_model) :: modal
    integer :: k
    modal%reduced_from = b%nf
    modal%static_shapes = static_shapes
    modal%unit = 1/sqrt(b%mass)
    modal%rotation = [(.false., k=1, size(w))]
    allocate (modal%psi(0:b%nf, size(w)), source=0.0_wp)
    modal%psi(1:, :) = x
    modal%rows = size(w)
    modal%angle = modal%rotation
    modal%columns = size(b%segments)
    modal%top_frequency = sqrt(max(maxval(w), 0.0_wp))
    k = size(w)
    if (size(b%dof, 1) > 3) k = k - static_shapes   ! those of cores are no vibrations
    do k = k, 2, -1                   ! a straight body moves across its axis rather than along it
      if (norm2(modal%psi(b%dof(2, :), k)) >= norm2(modal%psi(b%dof(1, :), k))) exit
      if (any(abs(b%x(2, :) - b%x(2, 1)) > half_digits*b%length)) exit
    end do
    modal%highest_bending = sqrt(max(w(k), 0.0_wp))
    modal%omega2 = w
    allocate (b%basis, source=modal)
  end subroutine set_basis

  !> Loads of which the static shapes are kept: a unit load on each loaded coordinate, and the inertia forces of the frame's
  !> accelerations along x, along y and about its origin, and of its spin.
  pure function static_loads(b, loaded) result(f)
    type(body_model), intent(in) :: b
    integer, intent(in) :: loaded(:)                    !! nodal coordinates
    real(wp) :: f(b%nf, size(loaded) + 4)               !! [N, N m], [kg, kg m]
    integer :: j
    f = 0.0_wp
    do j = 1, size(loaded)
      f(loaded(j), j) = 1.0_wp
    end do
    f(:, j:j + 1) = b%shape%sbar
    f(:, j + 2) = b%shape%c0
    f(:, j + 3) = b%shape%i1f
  end function static_loads

  !> Forces K_r x of each viscoelastic material r in each mode x, for bodies with cores. How much their layers slip depends on the
  !> modulus, which higher modes in bending do not make up for: K^-1 K_r x is the first order of what a change of it does to a mode.
  function layer_loads(b, x) result(f)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: x(:, :)                     !! (nf, modes) modes [m, rad, over kg^.5 m]
    real(wp), allocatable :: f(:, :)                    !! (nf, modes times materials) [N, N m, over kg^.5 m]
    integer :: k, j, i, r, number(maxval([0, b%segments%material]))
    if (size(b%dof, 1) == 3 .or. size(b%segments) == 0) then
      allocate (f(b%nf, 0))
      return
    end if
    number = 0
    do r = 1, size(b%segments)
      if (number(b%segments(r)%material) == 0) number(b%segments(r)%material) = maxval(number) + 1
    end do
    allocate (f(b%nf, size(x, 2)*maxval(number)), source=0.0_wp)
    do k = 1, size(b%op%entry)
      associate (row => b%op%symmetric%row(b%op%entry(k)), col => b%op%symmetric%col(b%op%entry(k)))
        i = size(x, 2)*(number(b%segments(b%op%segment(k))%material) - 1)
        do j = 1, size(x, 2)
          f(row, i + j) = f(row, i + j) + b%op%part(k)*x(col, j)
        end do
      end associate
    end do
  end function layer_loads

  !> Shape integrals, gyroscopic matrix, damping and material stiffnesses in the modal basis.
  subroutine project_integrals(b, x, w)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: x(:, :)                      !! (nf, modes) mass-normalised modes [m, rad, over kg^.5 m]
    real(wp), intent(in) :: w(:)                         !! (modes) squared frequencies [rad2/s2]
    type(elastic_operator) :: op                         ! of the modes
    real(wp), allocatable :: damping(:, :)               ! [1/s]
    b%shape%sbar = matmul(transpose(x), b%shape%sbar)
    b%shape%i1f = matmul(b%shape%i1f, x)
    b%shape%c0 = matmul(b%shape%c0, x)
    allocate (damping(size(x, 2), size(x, 2)))
    call join_segments(b, x, damping)
    call modal_operators(b%segments, w, projected(b%op%skew, b%op%z, x), projected(b%op%symmetric, b%op%j, x), damping, op)
    b%op = op
  end subroutine project_integrals

  !> Segments of one material become one, with its stiffness in the modal basis, and Rayleigh damping is that of the modes. Both
  !> are sums over the elements' deformations: forces of nodes lose what the motion of small elements as rigid bodies cancels.
  pure subroutine join_segments(b, x, damping)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: x(:, :)                      !! (nf, modes) mass-normalised modes [m, rad, over kg^.5 m]
    real(wp), intent(out) :: damping(:, :)               !! (modes, modes) [1/s]
    type(viscoelastic_segment), allocatable :: joined(:)
    real(wp) :: u(size(b%edof, 1), size(x, 2))           ! coordinates of an element in the modes [m, rad, over kg^.5 m]
    type(element_inertia) :: inertia
    integer :: of(maxval(b%segments%material))           ! number of a material's segment
    integer :: n, r, e, part
    of = 0
    n = 0
    do r = 1, size(b%segments)
      if (of(b%segments(r)%material) > 0) cycle
      n = n + 1
      of(b%segments(r)%material) = n
    end do
    allocate (joined(n))
    do r = size(b%segments), 1, -1
      joined(of(b%segments(r)%material)) = b%segments(r)
    end do
    do r = 1, size(b%segments)
      associate (all => joined(of(b%segments(r)%material)))
        if (all%layer /= b%segments(r)%layer) all%layer = 0
      end associate
    end do
    do r = 1, n
      joined(r)%first = r
      joined(r)%last = r
      allocate (joined(r)%stiffness(size(x, 2), size(x, 2)), source=0.0_wp)
    end do
    damping = 0.0_wp
    do e = 1, b%ne
      do r = 1, size(u, 1)
        u(r, :) = 0.0_wp
        if (b%edof(r, e) > 0) u(r, :) = x(b%edof(r, e), :)
      end do
      if (b%rayleigh) then
        inertia = inertia_of(b, e)
        damping = damping + strain_products(b, e, b%layers%kinds(b%layers%kind(e))%ray_k, u) &
                  + matmul(transpose(u), matmul(inertia%c, u))
      end if
      do part = 1, parts_of(b, e)
        r = b%layers%part(part, e)
        if (r == 0) cycle
        associate (all => joined(of(b%segments(r)%material)))
          all%stiffness = all%stiffness + strain_products(b, e, merge(1.0_wp, 0.0_wp, b%layers%row_part(:, e) == part), u)
        end associate
      end do
    end do
    damping = 0.5_wp*(damping + transpose(damping))      ! rounding of one half of it would be gyroscopic
    do r = 1, n
      joined(r)%stiffness = 0.5_wp*(joined(r)%stiffness + transpose(joined(r)%stiffness))
    end do
    b%segments = joined
  end subroutine join_segments

  !> X^T A X, A given by its entries on a pattern.
  pure function projected(pattern, a, x) result(y)
    type(symmetric_pattern), intent(in) :: pattern
    real(wp), intent(in) :: a(:)                         !! (entries) [any]
    real(wp), intent(in) :: x(:, :)                      !! (nf, modes) [m, rad, over kg^.5 m]
    real(wp) :: y(size(x, 2), size(x, 2))                !! [any]
    real(wp) :: ax(size(x, 1))                           ! [any]
    integer :: j
    do j = 1, size(x, 2)
      ax = 0.0_wp
      call add_product(pattern, a, x(:, j), ax)
      y(:, j) = matmul(ax, x)
    end do
  end function projected
end module modal_reduction
