!> Prepares the work space of a mechanism once, before anything moves: compact copies of the models, the ends of constraint
!> rows with the joint graph (`row_ends`), the attached places of flexible bodies (`attachments`).
module mechanism_setup
  use attachments, only: attach_places
  use kinds, only: wp
  use constraint, only: constraint_rows
  use like_bodies, only: find_like_bodies
  use mechanism, only: mechanism_model, factor_frame
  use row_ends, only: collect_ends
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: set_up_mechanism

contains

  !> Prepares the work space of a scene.
  subroutine set_up_mechanism(self, s)
    type(mechanism_model), intent(out) :: self
    type(scene), intent(in) :: s
    integer :: nb
    self%s = s
    nb = size(s%bodies)
    call self%p%allocate(size(s%places))
    call compact_models(self)
    call compact_places(self)
    call fixed_places(self)
    call allocate_rows(self%rows, s%rows)
    call collect_ends(self)
    allocate (self%attached(nb))
    call attach_places(self)
    call find_like_bodies(self)
    allocate (self%c(nb), self%sn(nb), self%low(3, nb), self%dinv(3, nb), self%rhs(3, nb), self%free(3, nb), self%push(3, nb), &
              self%pin(2, nb), source=0.0_wp)
    allocate (self%wrench(3, size(s%places)), self%lambda(s%rows), self%lambda_change(s%rows), self%a(s%nq), &
              self%change(s%nq), self%zdd(s%nz), source=0.0_wp)
    allocate (self%action(size(s%forces)))
    self%factorisations = count(s%bodies%flexible .and. .not. s%bodies%modal)
  end subroutine set_up_mechanism

  !> Copies what loops over many rigid bodies and places need, so that they need not touch the models.
  pure subroutine compact_models(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b
    self%flexible = self%s%bodies%flexible
    allocate (self%rigid(9, size(self%flexible)), source=0.0_wp)
    do b = 1, size(self%flexible)
      associate (bo => self%s%bodies(b), r => self%rigid(:, b))
        if (bo%flexible) cycle
        r(1) = bo%mass
        r(2:3) = bo%i1
        call factor_frame(bo%mass, 0.0_wp, bo%mass, -bo%i1(2), bo%i1(1), bo%i11, r(4:6), r(7:9))
      end associate
    end do
  end subroutine compact_models

  !> Sorts the places on bodies by what their motion follows from, and copies what is needed for that.
  pure subroutine compact_places(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: kind(:)             !! of each place: 0 ground, 1 rigid, 2 nodal, 3 modal
    integer :: k
    self%place_body = self%s%places%body
    allocate (kind(size(self%place_body)), source=0)
    allocate (self%place_dof(3, size(kind)), self%place_x(2, size(kind)))
    do k = 1, size(kind)
      self%place_dof(:, k) = self%s%places(k)%dof
      self%place_x(:, k) = self%s%places(k)%x
      if (self%place_body(k) == 0) cycle
      kind(k) = 1
      if (self%flexible(self%place_body(k))) kind(k) = merge(3, 2, allocated(self%s%places(k)%psi))
    end do
    self%rigid_places = pack([(k, k=1, size(kind))], kind == 1)
    self%nodal_places = pack([(k, k=1, size(kind))], kind == 2)
    self%modal_places = pack([(k, k=1, size(kind))], kind == 3)
  end subroutine compact_places

  !> Places on the ground never move.
  pure subroutine fixed_places(self)
    type(mechanism_model), intent(inout) :: self
    integer :: k
    do k = 1, size(self%s%places)
      if (self%s%places(k)%body == 0) self%p%r(:, k) = self%s%places(k)%x
      self%p%rho(:, k) = self%s%places(k)%x
    end do
  end subroutine fixed_places

  !> Arrays of constraint rows.
  pure subroutine allocate_rows(r, n)
    type(constraint_rows), intent(inout) :: r
    integer, intent(in) :: n
    allocate (r%na(2, n), r%nb(2, n), r%sa(n), r%sb(n), r%phi(n), r%phi_t(n), r%extra(n), source=0.0_wp)
  end subroutine allocate_rows
end module mechanism_setup
