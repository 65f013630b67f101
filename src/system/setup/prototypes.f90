!> Bodies that are made alike, as the links of a chain: their elastic constants are the same numbers, so that an evaluation may
!> read those of the first of them for all. A long chain of flexible links then moves little more than its states through
!> the processor's caches. The numbers being equal, so are the results, to the last bit.
module prototypes
  use kinds, only: wp
  use body, only: body_model
  use mechanism, only: mechanism_model, flexible_attachments
  implicit none (type, external)
  private
  public :: find_prototypes

  integer, parameter :: most_kinds = 8           !! kinds of body that a body is compared with, the latest ones

contains

  !> Sets prototype and attached_prototype of the mechanism. The prototype of a flexible body in nodal coordinates is the first body
  !> with the same constants; its attached prototype is the first that is also attached in the same way. Other bodies are their own.
  subroutine find_prototypes(self)
    type(mechanism_model), intent(inout) :: self
    integer :: kinds(most_kinds), attached_kinds(most_kinds), b, n
    n = size(self%s%bodies)
    self%prototype = [(b, b=1, n)]
    self%attached_prototype = self%prototype
    kinds = 0
    attached_kinds = 0
    do b = 1, n
      associate (body => self%s%bodies(b))
        if (.not. body%flexible) cycle
      end associate
      self%prototype(b) = first_prototype(self, b, kinds, .false.)
      self%attached_prototype(b) = first_prototype(self, b, attached_kinds, .true.)
    end do
  end subroutine find_prototypes

  !> The first body of the kind of b; b itself, which joins the list, where there is none.
  integer function first_prototype(self, b, kinds, attached) result(first)
    type(mechanism_model), intent(in) :: self
    integer, intent(in) :: b
    integer, intent(inout) :: kinds(:)           !! first bodies of the latest kinds, 0: none
    logical, intent(in) :: attached              !! attachments count
    integer :: k
    do k = 1, size(kinds)
      first = kinds(k)
      if (first == 0) exit
      if (.not. same_constants(self%s%bodies(first), self%s%bodies(b))) cycle
      if (.not. attached) return
      if (same_attachments(self%attached(first), self%attached(b))) return
    end do
    first = b
    kinds = [b, kinds(1:size(kinds) - 1)]
  end function first_prototype

  !> Whether an evaluation finds the same in two nodal bodies: what they are made of but for names, positions, internal variables.
  logical function same_constants(a, b) result(same)
    type(body_model), intent(in) :: a, b
    same = .false.
    if (a%nf /= b%nf .or. a%ne /= b%ne .or. size(a%lumps) /= size(b%lumps)) return
    if (a%stiffening .neqv. b%stiffening) return
    if (size(a%edof, 1) /= size(b%edof, 1)) return
    if (any(a%edof /= b%edof) .or. any(a%lumps%node /= b%lumps%node)) return
    same = equal(4, [a%mass, a%i1, a%i11], [b%mass, b%i1, b%i11]) .and. equal(size(a%lumps), a%lumps%mass, b%lumps%mass) .and. &
           equal(size(a%shape%sbar), a%shape%sbar, b%shape%sbar) .and. equal(a%nf, a%shape%i1f, b%shape%i1f) .and. &
           equal(a%nf, a%shape%c0, b%shape%c0) .and. equal(size(a%shape%pmat), a%shape%pmat, b%shape%pmat) .and. &
           equal(6*a%ne, constants(a), constants(b))
    if (same) same = same_layers(a, b)
    if (same) same = a%basis%same(b%basis)
  end function same_constants

  !> Whether the rows of two bodies' layers are the same in the same places, and what the layers damp and weigh.
  pure logical function same_layers(a, b) result(same)
    type(body_model), intent(in) :: a, b
    integer :: k
    same = size(a%layers%kinds) == size(b%layers%kinds) .and. size(a%layers%row) == size(b%layers%row) .and. &
           size(a%op%m) == size(b%op%m) .and. size(a%op%z) == size(b%op%z)
    if (.not. same) return
    same = all(a%layers%kind == b%layers%kind) .and. all(a%layers%row == b%layers%row) .and. &
           equal(size(a%op%m), a%op%m, b%op%m) .and. equal(size(a%op%j), a%op%j, b%op%j) .and. &
           equal(size(a%op%c), a%op%c, b%op%c) .and. equal(size(a%op%z), a%op%z, b%op%z)
    do k = 1, size(a%layers%kinds)
      associate (x => a%layers%kinds(k), y => b%layers%kinds(k))
        if (same) same = size(x%rows) == size(y%rows)
        if (same) same = equal(size(x%rows), x%rows, y%rows) .and. equal(size(x%force), x%force, y%force)
      end associate
    end do
  end function same_layers

  !> The elements' constants.
  pure function constants(b) result(x)
    type(body_model), intent(in) :: b
    real(wp) :: x(6*b%ne)                        ! [-, m, kg, N/m, N m]
    associate (e => b%elements)
      x = [e%c, e%s, e%length, e%mass, e%ea_l, e%ei_l]
    end associate
  end function constants

  !> Whether two bodies of the same constants are attached in the same way.
  pure logical function same_attachments(a, b) result(same)
    type(flexible_attachments), intent(in) :: a, b
    same = size(a%column) == size(b%column)
    if (same) same = all(a%column == b%column) .and. size(a%columns) == size(b%columns)
    if (.not. same) return
    same = equal(size(a%columns), a%columns, b%columns) .and. equal(size(a%compliance), a%compliance, b%compliance) .and. &
           equal(size(a%ep), a%ep, b%ep)
  end function same_attachments

  !> Whether two lists are the same numbers.
  pure logical function equal(n, x, y)
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n), y(n)           !! [any]
    equal = all(abs(x - y) <= 0.0_wp)
  end function equal
end module prototypes
