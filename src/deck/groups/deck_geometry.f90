!> Checks of the geometry of beams and frames: nodes, elements, connection, and the coordinates that fix the frame.
module deck_geometry
  use kinds, only: wp
  use text, only: to_text
  use deck_input, only: deck_source
  use deck_records, only: body_record
  implicit none (type, external)
  private
  public :: check_frame, check_reference, removed_coordinates

  real(wp), parameter :: apart = sqrt(epsilon(1.0_wp))   !! nearer nodes, over the body's size, are one to its stiffness [-]

contains

  !> Nodes and elements of a frame; `nodes` stays 0 where they are faulty. Of a faulty list the first fault is reported.
  subroutine check_frame(deck, b, paired)
    class(deck_source), intent(inout) :: deck
    type(body_record), intent(inout) :: b
    logical, intent(in) :: paired        !! whether element_nodes holds pairs
    integer :: before
    if (.not. (deck%is_set('node_x') .and. deck%is_set('node_y')) .or. size(b%node_x) /= size(b%node_y)) return
    before = deck%faults%count
    if (size(b%node_x) < 2) then
      call deck%complain('node_x', 'a frame has '//to_text(size(b%node_x))//' node, expected at least 2')
      return
    end if
    b%nodes = size(b%node_x)
    if (.not. (deck%is_set('element_nodes') .and. paired)) return
    call check_elements()
    if (deck%faults%count == before) call check_connected()
  contains
    !> Every element joins two different nodes that exist and has a length.
    subroutine check_elements()
      character(:), allocatable :: problem
      real(wp) :: size_of_frame              ! [m]
      integer :: k, i, j
      size_of_frame = hypot(maxval(b%node_x) - minval(b%node_x), maxval(b%node_y) - minval(b%node_y))
      do k = 1, b%elements
        i = b%element_nodes(1, k)
        j = b%element_nodes(2, k)
        problem = ''
        if (min(i, j) < 1 .or. max(i, j) > b%nodes) then
          problem = ': no such node, expected 1 to '//to_text(b%nodes)
        else if (hypot(b%node_x(j) - b%node_x(i), b%node_y(j) - b%node_y(i)) <= apart*size_of_frame) then
          problem = ' has no length, expected two nodes apart'
        end if
        if (len(problem) == 0) cycle
        call deck%complain('element_nodes', 'element '//to_text(k)//' from node '//to_text(i)//' to node '//to_text(j)//problem)
        return
      end do
    end subroutine check_elements

    !> Checks that elements connect all nodes.
    subroutine check_connected()
      integer, allocatable :: parent(:)
      integer :: k, i, j
      parent = [(k, k=1, b%nodes)]
      do k = 1, b%elements
        call find_root(parent, b%element_nodes(1, k), i)
        call find_root(parent, b%element_nodes(2, k), j)
        parent(max(i, j)) = min(i, j)
      end do
      do k = 2, b%nodes
        call find_root(parent, k, i)
        if (i == 1) cycle
        call deck%complain('element_nodes', 'node '//to_text(k)//' is not connected to node 1, expected elements that '// &
          'join all nodes')
        return
      end do
    end subroutine check_connected
  end subroutine check_frame

  !> Smallest node of the tree that a node belongs to; the path to it is shortened for later searches.
  pure subroutine find_root(parent, node, root)
    integer, intent(inout) :: parent(:)   !! (nodes) next node towards the root
    integer, intent(in) :: node
    integer, intent(out) :: root
    root = node
    do while (parent(root) /= root)
      parent(root) = parent(parent(root))
      root = parent(root)
    end do
  end subroutine find_root

  !> Checks that the reference coordinates, listed or chosen by a word, stop the three rigid motions of a flexible body.
  subroutine check_reference(deck, b)
    class(deck_source), intent(inout) :: deck
    type(body_record), intent(inout) :: b
    integer :: before
    before = deck%faults%count
    if (deck%is_given('reference_node') .or. deck%is_given('reference_dof')) then
      call check_lists()
      if (.not. (deck%is_set('reference_node') .and. deck%is_set('reference_dof'))) return
      if (deck%faults%count > before) return
      b%reference = 'explicit'
    end if
    if (.not. b%flexible .or. b%reference == 'free') return
    call check_rank()
  contains
    !> The two lists of reference coordinates: equal lengths, nodes that exist, nothing twice.
    subroutine check_lists()
      logical, allocatable :: removed(:, :)
      integer :: k, dof, before
      before = deck%faults%count
      where (b%reference_node == -1) b%reference_node = b%nodes
      k = findloc(b%reference_node >= 1 .and. b%reference_node <= b%nodes, .false., 1)
      if (k > 0) call deck%complain('reference_node', 'reference_node='//to_text(b%reference_node(k))// &
        ' is out of range, expected 1 to '//to_text(b%nodes)//' or -1 (the last)')
      if (deck%faults%count > before .or. size(b%reference_node) /= size(b%reference_dof)) return
      allocate (removed(3, b%nodes), source=.false.)
      do k = 1, size(b%reference_node)
        dof = index('uvr', b%reference_dof(k))
        if (removed(dof, b%reference_node(k)) .and. deck%faults%count == before) call deck%complain('reference_dof', &
          'coordinate '//b%reference_dof(k)//' of node '//to_text(b%reference_node(k))//' is removed twice, expected it once')
        removed(dof, b%reference_node(k)) = .true.
      end do
    end subroutine check_lists

    !> Reports removed coordinates that leave a rigid motion of the body free: a translation, or the rotation about the point whose
    !> x is that of all nodes without v and whose y is that of all nodes without u.
    subroutine check_rank()
      real(wp), allocatable :: x(:), y(:)    ! nodes [m]
      real(wp) :: extent                     ! of the body [m]
      logical :: removed(3, b%nodes)
      character(:), allocatable :: name, what
      integer :: k
      if (b%kind == 'frame') then
        x = b%node_x
        y = b%node_y
      else
        x = [(real(k, wp), k=0, b%elements)]           ! whatever the length
        allocate (y(size(x)), source=0.0_wp)
      end if
      extent = hypot(maxval(x) - minval(x), maxval(y) - minval(y))
      if (extent <= 0.0_wp) return
      removed = removed_coordinates(b)
      if (any(removed(1, :)) .and. any(removed(2, :))) then
        if (any(removed(3, :))) return
        if (maxval(y, removed(1, :)) - minval(y, removed(1, :)) > apart*extent) return
        if (maxval(x, removed(2, :)) - minval(x, removed(2, :)) > apart*extent) return
      end if
      name = 'reference'
      if (b%reference == 'explicit') name = 'reference_dof'
      what = 'reference=''pinned'' (u and v of the first node, v of the last) leaves'
      if (b%reference == 'explicit') what = 'the coordinates of reference_node and reference_dof leave'
      call deck%complain(name, what//' a translation or a rotation of the body free, expected u and v of a node and r of one, '// &
        'or u or v of another one across the line between them')
    end subroutine check_rank
  end subroutine check_reference

  !> Nodal coordinates (u, v, r of each node) that belong to the body's frame.
  pure function removed_coordinates(b) result(removed)
    type(body_record), intent(in) :: b
    logical :: removed(3, b%nodes)
    integer :: k
    removed = .false.
    select case (b%reference)
    case ('pinned')
      removed(1:2, 1) = .true.
      removed(2, b%nodes) = .true.
    case ('clamped')
      removed(:, 1) = .true.
    case ('explicit')
      do k = 1, min(size(b%reference_node), size(b%reference_dof))    ! of a faulty deck they differ
        removed(index('uvr', b%reference_dof(k)), b%reference_node(k)) = .true.
      end do
    case default   ! 'free': with modes
    end select
  end function removed_coordinates
end module deck_geometry
