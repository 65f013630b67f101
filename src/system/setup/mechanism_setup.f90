!> Prepares a mechanism and the room for its evaluations once, before anything moves: compact copies of the models, the sides of
!> constraint rows with the joint graph (`incidence`), the attached markers of flexible bodies (`attachments`).
module mechanism_setup
  use attachments, only: attach_markers
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use force_element, only: by_position
  use incidence, only: collect_incidence
  use mechanism, only: mechanism_model, factor_frame
  use multipliers, only: multiplier_system
  use prototypes, only: find_prototypes
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: set_up_mechanism

contains

  !> Prepares the mechanism of a scene and the room for its evaluations.
  subroutine set_up_mechanism(self, ev, s)
    type(mechanism_model), intent(out) :: self
    type(evaluation), intent(out) :: ev
    type(scene), intent(in) :: s
    type(multiplier_system) :: schur
    self%s = s
    call compact_models(self)
    call compact_markers(self)
    call collect_incidence(self, schur)
    allocate (self%attached(size(s%bodies)))
    call attach_markers(self)
    call find_prototypes(self)
    call set_up_evaluation(self, schur, ev)
  end subroutine set_up_mechanism

  !> Room for the evaluations of a mechanism, whose multipliers' matrix has been ordered; markers on the ground never move.
  subroutine set_up_evaluation(m, schur, ev)
    type(mechanism_model), intent(in) :: m
    type(multiplier_system), intent(in) :: schur     !! ordered by the joint graph
    type(evaluation), intent(out) :: ev
    integer :: nb, n, k
    nb = size(m%s%bodies)
    n = size(m%incidence%row)
    ev%schur = schur
    if (any(m%flexible)) ev%closing = schur
    associate (f => ev%frame)
      allocate (f%angle(nb), source=huge(1.0_wp))
      allocate (f%cos(nb), f%sin(nb), f%l(3, nb), f%dinv(3, nb), f%rhs(3, nb), f%free(3, nb), f%response(3, nb), &
                f%first_moment(2, nb), source=0.0_wp)
    end associate
    allocate (ev%side%w(3, n), ev%side%frame_wrench(3, n), ev%side%g(3, n), ev%side%rigid_wrench(3, n), source=0.0_wp)
    associate (r => ev%rows)
      n = m%s%rows
      allocate (r%na(2, n), r%nb(2, n), r%sa(n), r%sb(n), r%sc(n), r%phi(n), r%phi_t(n), r%acceleration_bias(n), source=0.0_wp)
      if (m%s%rows > m%s%permanent_rows) then
        allocate (r%off(n), source=[(k > m%s%permanent_rows, k=1, n)])
        allocate (r%acceleration(n), r%pressed(n), source=0.0_wp)
        associate (w => ev%slip)
          allocate (w%start(n), w%b(n), w%x(n), w%f(n), w%law(n), w%slope(2, size(m%s%friction)), w%ab(0, 0), source=0.0_wp)
          w%weighed = w%slope
          allocate (w%law_of(n), w%pivots(0), w%column(2, size(m%s%friction)), source=0)
        end associate
      end if
    end associate
    allocate (ev%dissipated_in(nb), source=0.0_wp)
    allocate (ev%elastic(nb), ev%attached(nb), ev%action(size(m%s%forces)), ev%work(2, maxval([0, m%s%bodies%nf])))
    do k = 1, nb
      if (.not. m%flexible(k)) cycle
      call ev%elastic(k)%allocate(m%s%bodies(k))
      ev%factorisations = ev%factorisations + m%s%bodies(k)%basis%factors
      n = size(m%attached(k)%marker)
      allocate (ev%attached(k)%ex(3, n), ev%attached(k)%ey(3, n), ev%attached(k)%load(size(m%attached(k)%columns, 2)), &
                source=0.0_wp)
    end do
    allocate (ev%displacement(3, size(m%s%markers)), source=0.0_wp)
    allocate (ev%wrench(3, size(m%s%markers)), ev%lambda(m%s%rows), ev%lambda_change(m%s%rows), ev%a(m%s%nq), &
              ev%change(m%s%nq), ev%zdd(m%s%nz), source=0.0_wp)
    allocate (ev%control(size(m%s%controllers)), ev%factor(size(m%s%factors)))
    allocate (ev%signals(0:1, size(m%s%forces) - m%s%acting), source=0.0_wp)
    do k = 1, size(ev%factor)
      allocate (ev%factor(k)%slopes(size(m%s%factors(k)%arguments)), source=0.0_wp)
    end do
    allocate (ev%loss(m%s%term_losses), source=0.0_wp)
    allocate (ev%switches%state(m%s%elements), source=by_position)
    allocate (ev%switches%event_value(m%s%elements), source=0.0_wp)
    call ev%p%allocate(size(m%s%markers))
    do k = 1, size(m%s%markers)
      if (m%s%markers(k)%body == 0) ev%p%r(:, k) = m%s%markers(k)%x
      ev%p%rho(:, k) = m%s%markers(k)%x
    end do
  end subroutine set_up_evaluation

  !> Copies what loops over many rigid bodies and markers need, so that they do not touch the models.
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
    self%markers%body = self%s%markers%body
    allocate (kind(size(self%markers%body)), source=0)
    allocate (self%markers%dof(3, size(kind)), self%markers%x(2, size(kind)))
    do k = 1, size(kind)
      self%markers%dof(:, k) = self%s%markers(k)%dof
      self%markers%x(:, k) = self%s%markers(k)%x
      if (self%markers%body(k) == 0) cycle
      kind(k) = 1
      if (self%flexible(self%markers%body(k))) kind(k) = merge(3, 2, allocated(self%s%markers(k)%psi))
    end do
    self%markers%rigid = pack([(k, k=1, size(kind))], kind == 1)
    self%markers%nodal = pack([(k, k=1, size(kind))], kind == 2)
    self%markers%modal = pack([(k, k=1, size(kind))], kind == 3)
  end subroutine compact_markers
end module mechanism_setup
