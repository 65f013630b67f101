!> Reduces a flexible body to its lowest modes and static shapes (`body_modes`): shape integrals, gyroscopic matrix, damping
!> and the materials' stiffness in the modal basis. Set-up work only.
module modal_reduction
  use kinds, only: wp
  use beam_element, only: element_stiffness, element_mass, element_gyroscopic
  use body, only: body_model
  use segment_model, only: viscoelastic_segment
  use body_operators, only: modal_operators
  use body_modes, only: lowest_modes, add_static_shapes
  use modal_basis, only: modal_model
  implicit none (type, external)
  private
  public :: reduce_to_modes

contains

  !> Replaces the nodal coordinates of a body by its `modes` lowest modes and by static shapes.
  subroutine reduce_to_modes(b, modes, shapes, loaded, viscoelastic, bad)
    type(body_model), intent(inout) :: b                !! nodal integrals are set
    integer, intent(in) :: modes                        !! modes kept
    logical, intent(in) :: shapes                       !! whether static shapes are kept, too
    integer, intent(in) :: loaded(:)                    !! nodal coordinates on which forces and moments act
    type(viscoelastic_segment), intent(in) :: viscoelastic(:) !! one entry a distinct viscoelastic material
    logical, intent(out) :: bad                         !! the eigenvalue problem failed
    real(wp), allocatable :: x(:, :), w(:)
    call lowest_modes(b, modes, x, w, bad)
    if (bad) return
    if (shapes) call add_static_shapes(b, static_loads(b, loaded), x, w, bad)
    if (bad) return
    call project_integrals(b, x, w, viscoelastic)
    call set_basis(b, nodal_shapes(b, x), w, size(w) - modes)
    b%nf = size(w)
  end subroutine reduce_to_modes

  !> The basis, and what others ask about it.
  pure subroutine set_basis(b, psi, w, static_shapes)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: psi(:, :)                   !! (3 nn, modes) displacements of nodes [m or rad, over kg^.5 m]
    real(wp), intent(in) :: w(:)                        !! (modes) squared frequencies [rad2/s2]
    integer, intent(in) :: static_shapes                !! how many of them are such
    type(modal_model) :: modal
    integer :: k
    modal%reduced_from = b%nf
    modal%static_shapes = static_shapes
    modal%unit = 1/sqrt(b%mass)
    modal%rotation = [(.false., k=1, size(w))]
    modal%reach = maxval(abs(psi), 1)
    modal%angle = modal%rotation
    modal%columns = size(b%segments)
    modal%carried = sqrt(max(maxval(w), 0.0_wp))
    do k = size(w), 2, -1             ! a straight body moves across its axis rather than along it
      if (norm2(psi(2::3, k)) >= norm2(psi(1::3, k))) exit
      if (any(abs(b%x(2, :) - b%x(2, 1)) > 1.0e-9_wp*b%length)) exit
    end do
    modal%highest_bending = sqrt(max(w(k), 0.0_wp))
    modal%psi = psi
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

  !> Shape integrals, gyroscopic matrix, damping and material stiffnesses in the modal basis.
  subroutine project_integrals(b, x, w, viscoelastic)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: x(:, :)                      !! (nf, modes) mass-normalised modes [m, rad, over kg^.5 m]
    real(wp), intent(in) :: w(:)                         !! (modes) squared frequencies [rad2/s2]
    type(viscoelastic_segment), intent(in) :: viscoelastic(:)
    real(wp), dimension(size(w), size(w)) :: z, inertia, c    ! gyroscopic, of lumps' rotation [-]; damping [1/s]
    real(wp) :: xe(6, size(w)), m(6, 6), k(6, 6)
    integer :: e, r, i, n
    n = size(w)
    b%shape%sbar = matmul(transpose(x), b%shape%sbar)
    b%shape%i1f = matmul(b%shape%i1f, x)
    b%shape%c0 = matmul(b%shape%c0, x)
    b%segments = viscoelastic
    z = 0.0_wp
    inertia = 0.0_wp
    c = 0.0_wp
    do r = 1, size(b%segments)
      allocate (b%segments(r)%stiffness(n, n), source=0.0_wp)
      b%segments(r)%first = r
      b%segments(r)%last = r
    end do
    do e = 1, b%ne
      do i = 1, 6
        xe(i, :) = 0.0_wp
        if (b%edof(i, e) > 0) xe(i, :) = x(b%edof(i, e), :)
      end do
      z = z + sandwich(xe, element_gyroscopic(b%elements(e)))
      k = element_stiffness(b%elements(e))
      if (b%rayleigh) then
        m = element_mass(b%elements(e))
        c = c + sandwich(xe, b%elements(e)%ray_m*m + b%elements(e)%ray_k*k)
      end if
      do r = 1, size(b%segments)
        if (b%segments(r)%material == b%elements(e)%material) b%segments(r)%stiffness = b%segments(r)%stiffness + sandwich(xe, k)
      end do
    end do
    call project_lumps(b, x, z, inertia)
    call modal_operators(b%segments, w, z, inertia, c, b%op)
  end subroutine project_integrals

  !> Lumps' part of the gyroscopic matrix, and their rotary inertia.
  pure subroutine project_lumps(b, x, z, inertia)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: x(:, :)   !! (nf, modes) mass-normalised modes [m, rad, over kg^.5 m]
    real(wp), intent(inout) :: z(:, :), inertia(:, :)   !! (modes, modes) [-]
    real(wp) :: xl(3, size(x, 2))
    integer :: k, c, i, j
    do k = 1, size(b%lumps)
      do c = 1, 3
        xl(c, :) = 0.0_wp
        associate (d => b%dof(c, b%lumps(k)%node))
          if (d > 0) xl(c, :) = x(d, :)
        end associate
      end do
      do j = 1, size(x, 2)
        do i = 1, size(x, 2)
          z(i, j) = z(i, j) + b%lumps(k)%mass*(xl(1, i)*xl(2, j) - xl(2, i)*xl(1, j))
          inertia(i, j) = inertia(i, j) + b%lumps(k)%inertia*xl(3, i)*xl(3, j)
        end do
      end do
    end do
  end subroutine project_lumps

  !> X^T A X for one element.
  pure function sandwich(x, a) result(y)
    real(wp), intent(in) :: x(:, :), a(6, 6)   !! the element's part of the modes, its matrix [any]
    real(wp) :: y(size(x, 2), size(x, 2)), ax(6, size(x, 2))
    ax = matmul(a, x)
    y = matmul(transpose(x), ax)
  end function sandwich

  !> Displacements of every node in every mode.
  pure function nodal_shapes(b, x) result(psi)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: x(:, :)   !! (nf, modes) mass-normalised modes [m, rad, over kg^.5 m]
    real(wp) :: psi(3*b%nn, size(x, 2))
    integer :: k, c
    psi = 0.0_wp
    do k = 1, b%nn
      do c = 1, 3
        if (b%dof(c, k) > 0) psi(3*(k - 1) + c, :) = x(b%dof(c, k), :)
      end do
    end do
  end function nodal_shapes
end module modal_reduction
