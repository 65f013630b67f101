!> Elastic blocks of the dynamic stiffness at the constants of a step: T0 = c1 m_ff + c2 C + K with viscoelastic terms condensed,
!> factored, its columns T0^-1 S-bar^T and T0^-1 E^T, and their products.
module elastic_columns
  use kinds, only: wp, number
  use body, only: body_model
  use condensed_system, only: condensed_matrix, condensed_body
  use condensed_terms, only: condensed_term
  use marker, only: marker_model
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: factor_blocks, fill_columns, seen

contains

  !> Takes the constants of a step: what viscoelastic terms add to stiffness, elastic blocks and their columns.
  subroutine factor_blocks(self, m, terms, c1, c2, bad)
    type(condensed_matrix), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(condensed_term), intent(in) :: terms(:)
    real(number), intent(in) :: c1           !! [1/s2]
    real(number), intent(in) :: c2           !! [1/s]
    logical, intent(out) :: bad
    integer :: b, k
    self%c1 = c1
    self%c2 = c2
    self%factored = .false.
    self%element_factor = 1.0_wp
    do b = 1, size(self%b)
      if (self%b(b)%n > 0) self%b(b)%block%factor = 1.0_wp
    end do
    do k = 1, size(terms)
      associate (t => terms(k), added => terms(k)%alpha*(1 - 1/(1 + terms(k)%viscosity*c2 + terms(k)%inertia*c1)))
        if (t%body > 0) then
          associate (f => self%b(t%body)%block%factor(t%segment))
            f = f + added
          end associate
        else
          self%element_factor(t%element) = self%element_factor(t%element) + added
        end if
      end associate
    end do
    bad = .false.
    do b = 1, size(self%b)
      associate (x => self%b(b))
        if (x%n == 0) cycle
        call x%block%factor_base(m%s%bodies(b), c1, c2, bad)
        if (bad) return
        call fill_columns(x, m%s%bodies(b), m%s%markers, .false.)
      end associate
    end do
    self%factored = .true.
  end subroutine factor_blocks

  !> Columns of the inverse elastic block, T0^-1 S-bar^T and T0^-1 E^T, and their products.
  subroutine fill_columns(t, body, markers, full_block)
    type(condensed_body), intent(inout) :: t
    type(body_model), intent(in) :: body
    type(marker_model), intent(in) :: markers(:)
    logical, intent(in) :: full_block        !! by the full block
    integer :: i, j
    associate (at => t%at)
      at%full_block = full_block
      at%xs = body%shape%sbar
      call t%block%solve_two(full_block, at%xs(:, 1), at%xs(:, 2))
      at%xe = 0.0_wp
      at%compliance = 0.0_wp
      do j = 1, size(at%xe, 2)
        associate (k => markers(at%marker(at%owner(j))), c => at%component(j))
          if (allocated(k%psi)) at%xe(:, j) = k%psi(c, :)
          if (.not. allocated(k%psi)) at%xe(k%dof(c), j) = 1.0_wp
        end associate
        call t%block%solve(full_block, at%xe(:, j))
        do i = 1, 2
          at%sxe(i, j) = dot_product(body%shape%sbar(:, i), at%xe(:, j))
        end do
        do i = 1, size(at%marker)
          at%compliance(:, at%component(j), i, at%owner(j)) = seen(markers(at%marker(i)), at%xe(:, j))
        end do
      end do
      do j = 1, 2
        do i = 1, 2
          at%pss(i, j) = dot_product(body%shape%sbar(:, i), at%xs(:, j))
        end do
        do i = 1, size(at%marker)
          at%exs(:, j, i) = seen(markers(at%marker(i)), at%xs(:, j))
        end do
      end do
    end associate
  end subroutine fill_columns

  !> E x: displacement and rotation of a marker by a vector of its body's elastic coordinates.
  pure function seen(marker, x) result(u)
    type(marker_model), intent(in) :: marker
    real(number), intent(in) :: x(:)         !! (n) [m, rad]
    real(number) :: u(3)
    integer :: c
    u = 0.0_wp
    if (allocated(marker%psi)) then
      do c = 1, size(x)
        u = u + marker%psi(:, c)*x(c)
      end do
    else
      do c = 1, 3
        if (marker%dof(c) > 0) u(c) = x(marker%dof(c))
      end do
    end if
  end function seen
end module elastic_columns
