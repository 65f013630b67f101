!> Reduces a flexible body to its lowest modes and static shapes (`body_modes`): shape integrals, gyroscopic matrix, damping
!> and the materials' stiffness in the modal basis. Set-up work only.
module modal_reduction
  use kinds, only: wp
  use beam_element, only: element_stiffness, element_mass, element_gyroscopic
  use body, only: body_model, viscoelastic_segment
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
    b%static_shapes = size(w) - modes
    call project_integrals(b, x, w, viscoelastic)
    call nodal_shapes(b, x)
    b%modal = .true.
    allocate (modal_model :: b%basis)
    b%nodal_nf = b%nf
    b%nf = size(w)
  end subroutine reduce_to_modes

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
    f(:, j:j + 1) = b%sbar
    f(:, j + 2) = b%c0
    f(:, j + 3) = b%i1f
  end function static_loads

  !> Shape integrals, gyroscopic matrix, damping and material stiffnesses in the modal basis.
  subroutine project_integrals(b, x, w, viscoelastic)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: x(:, :)                      !! (nf, modes) mass-normalised modes [m, rad, over kg^.5 m]
    real(wp), intent(in) :: w(:)                         !! (modes) squared frequencies [rad2/s2]
    type(viscoelastic_segment), intent(in) :: viscoelastic(:)
    real(wp) :: xe(6, size(w)), m(6, 6), k(6, 6)
    integer :: e, r, i, n
    n = size(w)
    b%sbar = matmul(transpose(x), b%sbar)
    b%i1f = matmul(b%i1f, x)
    b%c0 = matmul(b%c0, x)
    b%omega2 = w
    b%segments = viscoelastic
    allocate (b%zmodal(n, n), b%jmodal(n, n), b%cmodal(n, n), source=0.0_wp)
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
      b%zmodal = b%zmodal + sandwich(xe, element_gyroscopic(b%elements(e)))
      k = element_stiffness(b%elements(e))
      if (b%rayleigh) then
        m = element_mass(b%elements(e))
        b%cmodal = b%cmodal + sandwich(xe, b%elements(e)%ray_m*m + b%elements(e)%ray_k*k)
      end if
      do r = 1, size(b%segments)
        if (b%segments(r)%material == b%material(e)) b%segments(r)%stiffness = b%segments(r)%stiffness + sandwich(xe, k)
      end do
    end do
    call project_lumps(b, x)
  end subroutine project_integrals

  !> Lumps' part of the gyroscopic matrix, and their rotary inertia.
  subroutine project_lumps(b, x)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: x(:, :)   !! (nf, modes) mass-normalised modes [m, rad, over kg^.5 m]
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
          b%zmodal(i, j) = b%zmodal(i, j) + b%lumps(k)%mass*(xl(1, i)*xl(2, j) - xl(2, i)*xl(1, j))
          b%jmodal(i, j) = b%jmodal(i, j) + b%lumps(k)%inertia*xl(3, i)*xl(3, j)
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
  pure subroutine nodal_shapes(b, x)
    type(body_model), intent(inout) :: b
    real(wp), intent(in) :: x(:, :)   !! (nf, modes) mass-normalised modes [m, rad, over kg^.5 m]
    integer :: k, c
    allocate (b%psi(3*b%nn, size(x, 2)), source=0.0_wp)
    do k = 1, b%nn
      do c = 1, 3
        if (b%dof(c, k) > 0) b%psi(3*(k - 1) + c, :) = x(b%dof(c, k), :)
      end do
    end do
  end subroutine nodal_shapes
end module modal_reduction
