!> Prepares the work space of a mechanism once, before anything moves: compact copies of the models, the ends of constraint
!> rows with the joint graph (`incidence`), the attached markers of flexible bodies (`attachments`).
module mechanism_setup
  use attachments, only: attach_markers
  use kinds, only: wp
  use constraint, only: constraint_rows
  use prototypes, only: find_like_bodies
  use mechanism, only: mechanism_model, factor_frame
  use incidence, only: collect_incidence
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
    call self%p%allocate(size(s%markers))
    call compact_models(self)
    call compact_markers(self)
    call fixed_markers(self)
    call allocate_rows(self%rows, s%rows)
    call collect_incidence(self)
    allocate (self%attached(nb))
    call attach_markers(self)
    call find_like_bodies(self)
    allocate (self%cos_theta(nb), self%sin_theta(nb), self%frame_l(3, nb), self%frame_dinv(3, nb), self%rhs(3, nb), self%free(3, &
        nb), self%push(3, nb), &
              self%pin(2, nb), source=0.0_wp)
    allocate (self%wrench(3, size(s%markers)), self%lambda(s%rows), self%lambda_change(s%rows), self%a(s%nq), &
              self%change(s%nq), self%zdd(s%nz), source=0.0_wp)
    allocate (self%action(size(s%forces)))
    self%factorisations = count(s%bodies%flexible .and. .not. s%bodies%modal)
  end subroutine set_up_mechanism

  !> Copies what loops over many rigid bodies and markers need, so that they need not touch the models.
  pure subroutine compact_models(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b
    self%flexible = self%s%bodies%flexible
    allocate (self%rigid(9, size(self%flexible)), source=0.0_wp)
    do b = 1, size(self%flexible)
      associate (body => self%s%bodies(b), r => self%rigid(:, b))
        if (body%flexible) cycle
        r(1) = body%mass
        r(2:3) = body%i1
        call factor_frame(body%mass, 0.0_wp, body%mass, -body%i1(2), body%i1(1), body%i11, r(4:6), r(7:9))
      end associate
    end do
  end subroutine compact_models

  !> Sorts the markers on bodies by what their motion follows from, and copies what is needed for that.
  pure subroutine compact_markers(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: kind(:)             !! of each marker: 0 ground, 1 rigid, 2 nodal, 3 modal
    integer :: k
    self%marker_body = self%s%markers%body
    allocate (kind(size(self%marker_body)), source=0)
    allocate (self%marker_dof(3, size(kind)), self%marker_x(2, size(kind)))
    do k = 1, size(kind)
      self%marker_dof(:, k) = self%s%markers(k)%dof
      self%marker_x(:, k) = self%s%markers(k)%x
      if (self%marker_body(k) == 0) cycle
      kind(k) = 1
      if (self%flexible(self%marker_body(k))) kind(k) = merge(3, 2, allocated(self%s%markers(k)%psi))
    end do
    self%rigid_markers = pack([(k, k=1, size(kind))], kind == 1)
    self%nodal_markers = pack([(k, k=1, size(kind))], kind == 2)
    self%modal_markers = pack([(k, k=1, size(kind))], kind == 3)
  end subroutine compact_markers

  !> Markers on the ground never move.
  pure subroutine fixed_markers(self)
    type(mechanism_model), intent(inout) :: self
    integer :: k
    do k = 1, size(self%s%markers)
      if (self%s%markers(k)%body == 0) self%p%r(:, k) = self%s%markers(k)%x
      self%p%rho(:, k) = self%s%markers(k)%x
    end do
  end subroutine fixed_markers

  !> Arrays of constraint rows.
  pure subroutine allocate_rows(r, n)
    type(constraint_rows), intent(inout) :: r
    integer, intent(in) :: n
    allocate (r%na(2, n), r%nb(2, n), r%sa(n), r%sb(n), r%phi(n), r%phi_t(n), r%acceleration_bias(n), source=0.0_wp)
  end subroutine allocate_rows
end module mechanism_setup
