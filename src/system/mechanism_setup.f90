!> Prepares a mechanism and the room for its evaluations once, before anything moves: compact copies of the models, the sides of
!> constraint rows with the joint graph (`incidence`), the attached markers of flexible bodies (`attachments`).
module mechanism_setup
  use attachments, only: attach_markers
  use kinds, only: wp
  use evaluation_results, only: evaluation, set_up_evaluation
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
